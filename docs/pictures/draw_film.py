"""Draw the moving picture of the README and the views of docs/how-to/pictures.md, from results of ``vowel-i`` and ``vowel-a``.

python docs/pictures/draw_film.py outputs/vowel-i.vtkhdf outputs/vowel-a.vtkhdf [FOLDER]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from PIL import Image

from explicitfe.app.view.scene.show import FileKind, show

HERE = Path(__file__).resolve().parent
FILM_SIZE_PX, VIEW_SIZE_PX, PART_SIZE_PX = (720, 540), (960, 720), (720, 540)
MOUTH_VIEWS = ("side", "oblique", "top", "front")
COLOURS_OF_MOUTH = 255
# Name of a picture -> kind, from where, and the field.
PICTURES: dict[str, tuple[FileKind, str, str]] = {
    "vowel-i.gif": ("gif", "midsagittal", "displacement"),
    "vowel-i-oblique.png": ("png", "oblique", "displacement"),
    "vowel-i-volume.png": ("png", "midsagittal", "J"),
}


def main() -> None:
    """Draw each picture under its own name."""
    vowel_i, vowel_a = Path(sys.argv[1]), Path(sys.argv[2])
    folder = Path(sys.argv[3]) if len(sys.argv) > 3 else HERE
    for name, (kind, view, field) in PICTURES.items():
        size_px = FILM_SIZE_PX if kind == "gif" else VIEW_SIZE_PX
        with tempfile.TemporaryDirectory(dir=folder) as beside:
            drawn = show(vowel_i, view, field=field, files=[kind], folder=Path(beside), size_px=size_px)
            Path(drawn["files"][0]).replace(folder / name)
        print(f"written: {folder / name}, {(folder / name).stat().st_size / 1e6:.2f} MB")
    draw_mouth(vowel_a, folder / "mouth.png")


def draw_mouth(result: Path, target: Path) -> None:
    """Draw a tongue between teeth from four sides, without a field."""
    width, height = PART_SIZE_PX
    sheet = Image.new("RGB", (2 * width, 2 * height))
    with tempfile.TemporaryDirectory() as folder:
        for number, view in enumerate(MOUTH_VIEWS):
            parts = ("fibres", "rest")
            drawn = show(result, view, field="none", without=parts, files=["png"], folder=Path(folder), size_px=PART_SIZE_PX)
            with Image.open(drawn["files"][0]) as part:
                sheet.paste(part, (number % 2 * width, number // 2 * height))
    sheet.quantize(COLOURS_OF_MOUTH).save(target, optimize=True)
    print(f"written: {target}, {target.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
