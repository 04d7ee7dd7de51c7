"""Losses by a file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from iout_marl.core.grid import Floats
from iout_marl.errors import InputError
from iout_marl.parts.loss.base import Loss, losses
from iout_marl.scenario import Scenario
from iout_marl.scenario.data_files import DataFile
from iout_marl.scenario.data_readers import read_curve
from iout_marl.scenario.fields import invalid
from iout_marl.scenario.parts import Settings as PartSettings

if TYPE_CHECKING:
    from iout_marl.parts.uplink.base import Uplink


@losses.register("table")
class Table(Loss):
    """Losses by a file with the columns snr_db and packet_error_rate, as measured or simulated.

    Between its lines the share changes evenly with the ratio in dB, beyond them it stays.
    """

    class Settings(PartSettings):
        #: The file, CSV or npz.
        file: DataFile

    settings: Settings
    loses = True

    def check(self, scenario: Scenario) -> None:  # noqa: ARG002
        try:
            self._read()
        except InputError as error:
            raise invalid(("uplink", "loss", "file"), str(error)) from None

    def packet_error_rate(self, snr_db: Floats, uplink: Uplink) -> Floats:  # noqa: ARG002
        return np.interp(snr_db, *self._read())

    def _read(self) -> tuple[Floats, Floats]:
        """Ratios in dB, rising, and shares.

        Raises:
            InputError: the file has none.
        """
        return read_curve(self.settings.file, ("snr_db", "packet_error_rate"), 0, 1)
