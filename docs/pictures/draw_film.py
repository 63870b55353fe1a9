"""Draw the moving picture of the README, and the views of the gallery, from a result of ``vowel-i``.

python docs/pictures/draw_film.py outputs/vowel-i.vtkhdf [FOLDER]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from explicitfe.app.view.scene.show import FileKind, show

HERE = Path(__file__).resolve().parent
FILM_SIZE_PX, VIEW_SIZE_PX = (720, 540), (960, 720)
# Name of a picture -> kind, from where, and the field.
PICTURES: dict[str, tuple[FileKind, str, str]] = {
    "vowel-i.gif": ("gif", "midsagittal", "displacement"),
    "vowel-i-oblique.png": ("png", "oblique", "displacement"),
    "vowel-i-volume.png": ("png", "midsagittal", "J"),
}


def main() -> None:
    """Draw each picture under its own name."""
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else HERE
    for name, (kind, view, field) in PICTURES.items():
        size_px = FILM_SIZE_PX if kind == "gif" else VIEW_SIZE_PX
        with tempfile.TemporaryDirectory(dir=folder) as beside:
            drawn = show(Path(sys.argv[1]), view, field=field, files=[kind], folder=Path(beside), size_px=size_px)
            Path(drawn["files"][0]).replace(folder / name)
        print(f"written: {folder / name}, {(folder / name).stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
