"""From a name or a path to the text of a TOML file, shipped in the package or anybody's."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path


@dataclass(frozen=True)
class Shelf:
    """The TOML files of one kind that a package ships."""

    kind: str  # as sentences name it: "mission"
    package: str
    folder: str = ""  # below the package

    @property
    def path(self) -> Path:
        """Where they are; the package is a folder, never an archive: others read tables beside them."""
        return Path(str(resources.files(self.package))) / self.folder

    @property
    def names(self) -> list[str]:
        """Names of the files, without .toml."""
        return sorted(file.stem for file in self.path.glob("*.toml"))

    def find(self, name_or_path: str | Path) -> tuple[str, Path]:
        """Label for sentences, and the path of the file.

        Raises
        ------
        ValueError
            If there is no such file and no shipped one of that name.
        """
        path, known = Path(name_or_path), self.names
        if str(name_or_path) in known and not path.is_file():
            return str(name_or_path), self.path / f"{name_or_path}.toml"
        if path.is_file():
            return str(path), path
        if path.suffix == ".toml" or path.exists():
            raise ValueError(f"{self.kind}: no file at {path}")
        raise ValueError(
            f"{self.kind}: expected one of {', '.join(known)} or the path of a .toml file, "
            f"got {str(name_or_path)!r}"
        )

    def read(self, name_or_path: str | Path) -> tuple[str, str]:
        """Label and text.

        Raises
        ------
        ValueError
            If there is no such file, or it is no text.
        """
        label, path = self.find(name_or_path)
        try:
            return label, path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            raise ValueError(f"{label}: not a text file in UTF-8") from None
