"""What became of loss, PSNR and anchors over training: a CSV file and, where asked for, TensorBoard."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING

from torch import Tensor

from aa4d.errors import InputError
from aa4d.files import write_text

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

EVERY = 20  # iterations that a row is the mean of
COLUMNS = ("step", "stage", "iteration", "loss", "psnr_db", "anchors", "seconds")


class History:
    """Rows of `history.csv` in the run's folder, `step` counting iterations over both stages.

    Rows wait in memory until a checkpoint is written and are written before it. A run that continues forgets the rows
    after its checkpoint, so none stands twice.
    """

    def __init__(self, out: Path, step: int, *, tensorboard: bool) -> None:
        """`step`: iterations done so far. Raises InputError where TensorBoard is asked for and not installed."""
        self._path = out / "history.csv"
        self._rows = [row for row in _read(self._path) if int(row[0]) <= step]
        self._written = len(self._rows)
        self._window: list[tuple[float, float]] = []
        self._board = board(out / "tensorboard", step) if tensorboard else None

    def add(
        self, step: int, stage: str, iteration: int, loss: float, psnr_db: float, anchors: int, seconds: float
    ) -> None:
        self._window.append((loss, psnr_db))
        if step % EVERY == 0:
            mean_loss, mean_psnr = (sum(values) / len(values) for values in zip(*self._window, strict=True))
            self._window.clear()
            row = (step, stage, iteration, f"{mean_loss:.6g}", f"{mean_psnr:.4f}", anchors, f"{seconds:.2f}")
            self._rows.append([str(value) for value in row])

    def write(self, step: int, image: Tensor | None = None, target: Tensor | None = None) -> None:
        """Everything so far. `image` and `target` [H, W, 3] in [0, 1]: TensorBoard shows them side by side."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([COLUMNS, *self._rows])
        write_text(self._path, text.getvalue())
        if self._board is not None:
            for row in self._rows[self._written :]:
                for name in ("loss", "psnr_db", "anchors", "seconds"):
                    self._board.add_scalar(f"training/{name}", float(row[COLUMNS.index(name)]), int(row[0]))
            if image is not None and target is not None:
                pair = image.new_zeros(image.shape[0], 2 * image.shape[1], 3)
                pair[:, : image.shape[1]], pair[:, image.shape[1] :] = image.clamp(0, 1), target
                self._board.add_image("training/rendered_beside_frame", pair.cpu(), step, dataformats="HWC")
            self._board.flush()
        self._written = len(self._rows)

    @property
    def wants_images(self) -> bool:
        return self._board is not None

    def close(self) -> None:
        if self._board is not None:
            self._board.close()


def _read(path: Path) -> list[list[str]]:
    """Rows of a history; none where there is no file or its columns are others'.

    Raises:
        InputError: a row is not of the kind that `History` writes.
    """
    if not path.exists():
        return []
    try:
        rows = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))
        if not rows or rows[0] != list(COLUMNS):
            return []
        for row in rows[1:]:
            values = dict(zip(COLUMNS, row, strict=True))
            for column in ("step", "iteration", "anchors"):
                int(values[column])
            for column in ("loss", "psnr_db", "seconds"):
                float(values[column])
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as a history ({error}); delete it to go on without") from None
    return rows[1:]


def board(folder: Path, step: int) -> SummaryWriter:
    """A writer of TensorBoard's files, which goes on after `step`. Raises InputError where that is not installed."""
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise InputError("--tensorboard: needs the package tensorboard; pip install tensorboard") from None
    # Readers drop what an earlier process wrote from this step on: nothing is shown twice.
    return SummaryWriter(str(folder), purge_step=step + 1)
