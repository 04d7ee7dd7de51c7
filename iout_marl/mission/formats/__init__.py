"""The formats of mission files, one in each module."""

from iout_marl.errors import InputError, did_you_mean
from iout_marl.mission.formats import csv_file, geojson, gpx, imc, kml, moos, qgc_plan, wpl
from iout_marl.mission.formats.base import Format

__all__ = ["FORMATS", "Format", "format_named"]

FORMATS: dict[str, Format] = {
    module.FORMAT.name: module.FORMAT
    for module in (qgc_plan, wpl, imc, moos, geojson, kml, gpx, csv_file)
}


def format_named(name: str) -> Format:
    """A format by its name.

    Raises:
        InputError: there is none of that name.
    """
    if name not in FORMATS:
        raise InputError(f"unknown format {name!r}{did_you_mean(name, FORMATS)}")
    return FORMATS[name]
