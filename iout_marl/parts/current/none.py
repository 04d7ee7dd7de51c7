"""Still water."""

from iout_marl.parts.current.base import Current, currents


@currents.register("none")
class Still(Current):
    """Still water, as in the paper."""

    flows = False
