"""Coast lines for the explorer: Natural Earth's land at 1:50 million as one small file.

python scripts/make_coast.py land-50m.json ampi/explorer/natural_earth_land.json

`land-50m.json` is Natural Earth's land (version 4.1, public domain) as TopoJSON, from the npm package
world-atlas 2.0.2. Islands below a size are left out, and points nearer than `NEAREST` to the last one.
Points are whole hundredths of a degree, each as its difference from the last.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

SMALLEST = 0.05  # square degrees at the equator
NEAREST = 0.08  # degrees
SOURCE = "Natural Earth, land 1:50m, version 4.1, public domain (naturalearthdata.com)"


def arcs_of(topology: dict[str, Any]) -> list[NDArray[np.float64]]:
    """Arcs in degrees: whole steps, delta-encoded."""
    scale, shift = (np.array(topology["transform"][name]) for name in ("scale", "translate"))
    return [np.cumsum(arc, axis=0) * scale + shift for arc in topology["arcs"]]


def rings_of(topology: dict[str, Any]) -> list[NDArray[np.float64]]:
    """Closed outer rings; lakes are land."""
    arcs, rings = arcs_of(topology), []
    for geometry in topology["objects"]["land"]["geometries"]:
        for polygon in geometry["arcs"]:
            parts = [arcs[k] if k >= 0 else arcs[~k][::-1] for k in polygon[0]]
            rings.append(np.concatenate([parts[0], *(part[1:] for part in parts[1:])]))
    return rings


def area(ring: NDArray[np.float64]) -> float:
    """Square degrees, by the shoelace formula, narrower towards the poles."""
    x, y = ring.T
    flat = 0.5 * abs(float(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1])))
    return flat * float(np.cos(np.radians(y.mean())))


def thinned(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Without points that lie near the last one that is kept; the first and the last stay."""
    kept = [ring[0]]
    for point in ring[1:-1]:
        if np.abs(point - kept[-1]).max() > NEAREST:
            kept.append(point)
    return np.array([*kept, ring[-1]])


def main() -> None:
    """Read, thin out, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("topology", type=Path)
    parser.add_argument("output", type=Path)
    arguments = parser.parse_args()
    rings = [r for r in rings_of(json.loads(arguments.topology.read_text())) if area(r) > SMALLEST]
    whole = []
    for ring in rings:
        steps = np.rint(100.0 * thinned(ring)).astype(int)
        whole.append(np.diff(steps, axis=0, prepend=0).reshape(-1).tolist())
    content = {"source": SOURCE, "unit": "0.01 deg, differences", "rings": whole}
    arguments.output.write_text(json.dumps(content, separators=(",", ":")) + "\n")
    points = sum(len(ring) // 2 for ring in whole)
    print(f"{len(whole)} rings, {points} points, {arguments.output.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
