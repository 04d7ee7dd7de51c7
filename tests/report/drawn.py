"""An interactive figure, read back."""

import json

from iout_marl.report.plotly_writer import plotly_json


def traces(figure, **wanted):
    """The traces of an interactive figure that have these values."""
    data = json.loads(plotly_json(figure))["data"]
    return [t for t in data if all(t.get(key) == value for key, value in wanted.items())]


def layout(figure):
    return json.loads(plotly_json(figure))["layout"]
