"""``explicitfe plot``."""

from __future__ import annotations

from pathlib import Path

from explicitfe.app.api.source import is_sweep
from explicitfe.app.cli.answer import console, print_answer
from explicitfe.app.cli.command import command
from explicitfe.app.view.progress import following
from explicitfe.platform.errors import InputError


@command(only="--only NAMES")
def plot(
    results: list[Path],
    *,
    only: str | None = None,
    file_format: str = "png",
    times: str | None = None,
    out: Path | None = None,
    overwrite: bool = False,
    as_json: bool = False,
) -> None:
    """Draw pictures of a result or of a sweep; for several results, overlay their midsagittal contours.

    Examples: [bold]explicitfe plot outputs/vowel-i.vtkhdf --only contour,probes --format pdf --times 20,50,200[/bold]

    [bold]explicitfe plot outputs/vowel-i.vtkhdf outputs/vowel-a.vtkhdf --times 100[/bold]

    Parameters
    ----------
    results : result file (.vtkhdf), its name in outputs/, several of them to overlay, or the folder of a sweep.
    only : pictures to draw, separated by commas. Run: contour, coronal, probes, energies, palatogram, airway, 3d, hourglass, and
        reaction:NAME, the force-displacement curve of a support or fixed node set. Indentation: curve, section. Sweep: outlines,
        effects, maps, indices, or two columns as A:B; by default all.
    file_format : file format: png, pdf or svg.
    times : times to draw in ms, separated by commas. Pictures of a single time show the last of them.
    out : output folder; by default that of the result.
    overwrite : replace existing files.
    """
    names = None if only is None else [name.strip() for name in only.split(",")]
    times_s = None if times is None else [1e-3 * _number(text) for text in times.split(",")]
    with following(console, f"reading {results[0]}") as progress:
        from explicitfe.app.view.terminal.drawn import drawn_table

        if sweeps := [path for path in results if is_sweep(path)]:
            from explicitfe.app.view.page.sweep.pictures import draw_sweep
            from explicitfe.simulate.sweep.page_data import sweep_to_draw

            if len(results) > 1:
                raise InputError(f"{sweeps[0]} is a sweep, which cannot be overlaid; name only this folder.")
            if times_s is not None:
                raise InputError(f"{sweeps[0]} is a sweep, which has no times to draw; leave out --times.")
            drawn = draw_sweep(
                sweep_to_draw, sweeps[0], out, only=names, file_format=file_format, overwrite=overwrite, progress=progress
            )
        elif len(results) > 1:
            from explicitfe.app.view.overlay import draw_overlay

            drawn = draw_overlay(
                results, out, only=names, file_format=file_format, times_s=times_s, overwrite=overwrite, progress=progress
            )
        else:
            from explicitfe.app.view.draw import draw

            drawn = draw(
                results[0], out, only=names, file_format=file_format, times_s=times_s, overwrite=overwrite, progress=progress
            )
    print_answer(drawn, as_json, lambda: drawn_table(drawn), drawn["warnings"])


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f'--times: "{text.strip()}" is not a number of milliseconds; give times such as 20,50,200.') from None
