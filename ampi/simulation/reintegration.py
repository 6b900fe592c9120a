"""Re-integration under the name of the room that flies; it stands in `ampi.propagation`."""

from ampi.propagation import reintegrate, reintegrate_many

__all__ = ["reintegrate", "reintegrate_many"]
