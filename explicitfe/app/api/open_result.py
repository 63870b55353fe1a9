"""``explicitfe.open_result``: a result that shows itself in a notebook."""

from __future__ import annotations

from html import escape

from explicitfe.app.api.source import Source, path_of
from explicitfe.platform.errors import InputError
from explicitfe.results.files import Result
from explicitfe.results.files.reader import open_result as open_file

FRAME = '<iframe srcdoc="{page}" width="100%" height="{height}" style="border:0" title="{title}"></iframe>'
FRAME_HEIGHT_PX = 900


class NotebookResult(Result):
    """A :class:`~explicitfe.results.Result` that a notebook shows as its report page."""

    def _repr_html_(self) -> str | None:
        """The report page in a frame; None, and so the plain text, if the result has no step that can be drawn."""
        from explicitfe.app.view.page.run.write import report_text  # a run without a notebook does not wait for pages

        try:
            page = report_text([self])
        except InputError:
            return None
        return FRAME.format(page=escape(page), height=FRAME_HEIGHT_PX, title=escape(str(self.path)))


def open_result(result: Source) -> NotebookResult:
    """Open a result; use it in a ``with`` block, or call ``close()``.

    Parameters
    ----------
    result : path of a result file, its name in the folder ``outputs``, or what :func:`run` returned.

    Returns
    -------
    The open result, with ``times``, ``displacement(step)``, ``field(name, step)``, ``probe(name)``, ``history(name)``,
    ``mesh_at(step)``, ``to_pandas()``, ``summary`` and more. A notebook shows it as its report page.

    Raises
    ------
    InputError : there is no such file, it is no result, or it is damaged.
    """
    return open_file(path_of(result), NotebookResult)
