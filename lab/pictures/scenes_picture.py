"""The picture of twelve simulated scenes in docs/scenes.md.

``lab/pictures/scenes_picture.py [FILE]`` draws four scenes of each kind, 2,000 m² at 60 points a square
metre, to docs/images/scenes.jpg by default: labels over the relief on the left, hard negatives on the right.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from PIL import Image
from slopewatch.lab.pictures.small_jpeg import keep_small
from slopewatch.simulation.hazard_scenes.picture import draw_panels, panels
from slopewatch.simulation.hazard_scenes.scenes import scene

SEEDS = {
    "published": (1000, 1001, 1002, 1003),
    "realistic": (1000, 1002, 1003, 1005),
    "shifted": (1000, 1001, 1002, 1004),
}


def main(path: Path) -> None:
    """Draw the picture."""
    chosen = [(kind, seed) for kind, seeds in SEEDS.items() for seed in seeds]
    drawn = [panels(scene(seed, kind, area=2000.0, density=60.0), cell=0.2) for kind, seed in chosen]
    # Scenes of similar height next to each other.
    order = sorted(range(len(chosen)), key=lambda k: (list(SEEDS).index(chosen[k][0]), drawn[k].ratio))
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "scenes.png"
        draw_panels([drawn[k] for k in order], whole, across=2, width=14.0, small_file=True)
        keep_small(Image.open(whole), path)
    print(f"{path} ({path.stat().st_size / 1e3:.0f} kB)")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[2] / "docs/images/scenes.jpg")
