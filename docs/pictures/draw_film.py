"""Draw the film and first picture of the README, and the views of docs/how-to/pictures.md, from results of three vowels.

python docs/pictures/draw_film.py outputs/vowel-i-palatal.vtkhdf outputs/vowel-i.vtkhdf outputs/vowel-a.vtkhdf [FOLDER]
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
FILM = "vowel-i-palatal"
# Name of a picture of vowel [i] -> from where, and the field.
VIEWS = {"vowel-i-oblique.png": ("oblique", "displacement"), "vowel-i-volume.png": ("midsagittal", "J")}


def main() -> None:
    """Draw each picture under its own name."""
    palatal, vowel_i, vowel_a = map(Path, sys.argv[1:4])
    folder = Path(sys.argv[4]) if len(sys.argv) > 4 else HERE
    draw(palatal, "gif", "side", "none", folder / f"{FILM}.gif", without=("fibres",))
    draw_ends(folder / f"{FILM}.gif", folder / f"{FILM}.png")
    for name, (view, field) in VIEWS.items():
        draw(vowel_i, "png", view, field, folder / name)
    draw_mouth(vowel_a, folder / "mouth.png")


def draw(result: Path, kind: FileKind, view: str, field: str, target: Path, without: tuple[str, ...] = ()) -> None:
    """Draw one picture or film."""
    size_px = FILM_SIZE_PX if kind == "gif" else VIEW_SIZE_PX
    with tempfile.TemporaryDirectory(dir=target.parent) as beside:
        drawn = show(result, view, field=field, without=without, files=[kind], folder=Path(beside), size_px=size_px)
        Path(drawn["files"][0]).replace(target)
    print(f"written: {target}, {target.stat().st_size / 1e6:.2f} MB")


def draw_ends(film: Path, target: Path) -> None:
    """Draw the first and the last frame of a film side by side."""
    width, height = FILM_SIZE_PX
    sheet = Image.new("RGB", (2 * width, height))
    with Image.open(film) as frames:
        for number, frame in enumerate((0, frames.n_frames - 1)):
            frames.seek(frame)
            sheet.paste(frames.convert("RGB"), (number * width, 0))
    sheet.quantize(COLOURS_OF_MOUTH).save(target, optimize=True)
    print(f"written: {target}, {target.stat().st_size / 1e6:.2f} MB")


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
