"""What every part is, and what a part of a world works with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from iout_marl.arrays.backend import Backend
from iout_marl.arrays.nodes import NodeAxis
from iout_marl.core.chance import Draw
from iout_marl.core.credit import Credit
from iout_marl.core.current import CurrentField
from iout_marl.core.grid import Grid
from iout_marl.core.link import Link
from iout_marl.core.view import View
from iout_marl.errors import InputError
from iout_marl.physics.arrays import Array
from iout_marl.registry import Entry
from iout_marl.scenario import Scenario
from iout_marl.scenario.parts import Settings as PartSettings

if TYPE_CHECKING:
    from iout_marl.parts.observation import Representation


@dataclass(frozen=True)
class Context:
    """What a part of a world works with.

    Attributes:
        scenario: the scenario.
        num_envs: environments in the batch.
        backend: array library, floating type, device.
        grid: the grid and its codes.
        link: tables of the links between cells.
        nodes: gathers from, scatters to and sums over the axis of nodes.
        credit: whom the network's reward is credited to.
        view: what AUVs know of nodes that they do not see.
        representation: how observations write positions, ages, energies.
        current: the current of the water; None where it is still.
        neighbours: gives the cells that a move in each direction ends in, (envs, auvs, directions)
            codes, from those of (envs, auvs) cells.
        needed_j: gives the least energy that a node must have stored to deliver in a slot in which
            it is charged and heard, by offset (see `Link`).
    """

    scenario: Scenario
    num_envs: int
    backend: Backend
    grid: Grid
    link: Link
    nodes: NodeAxis
    credit: Credit
    view: View
    representation: Representation
    current: CurrentField | None
    neighbours: Callable[[Array], Array]
    needed_j: Callable[[], Array]


def at_work(settings: Any, world: Context) -> Any:
    """A part of one world, set up for it; `settings` are a scenario's."""
    with settings.entry.blamed():
        part = settings.entry.item(settings)
        part.setup(world)
    return part


class Part:
    """One choice of a scenario: its settings, what it states of itself, what it does.

    A part is made from its settings alone, and then answers questions about itself. A world makes
    parts of its own and sets them up: only then they do their work on arrays.

    Attributes:
        Settings: the keys that a scenario file has for it, a subclass of `parts.Settings`.
        settings: their values.
        xp: namespace of the array library, once it is set up.
        nodes_are_alike, auvs_are_alike: whether what it makes of nodes, and of AUVs, does not
            depend on how they are numbered: where they are permuted, so are its results.
        reads_origin: whether results depend on `grid.origin` by it: which is in the hash then.
        is_of_world: whether it works in a world; if not, in a training.
    """

    nodes_are_alike: ClassVar[bool] = True
    auvs_are_alike: ClassVar[bool] = True
    reads_origin: bool = False
    is_of_world: ClassVar[bool] = True

    if TYPE_CHECKING:
        Settings: ClassVar[type[PartSettings]]
    else:
        Settings = PartSettings

    xp: Any

    def __init__(self, settings: Any) -> None:
        self.settings = settings

    def check(self, scenario: Scenario) -> None:
        """See that the settings go together with those of others.

        Raises:
            pydantic_core.PydanticCustomError: they do not; by `parts.invalid`.
        """

    def draws(self, scenario: Scenario) -> dict[str, Draw]:  # noqa: ARG002
        """What it leaves to chance in a slot of one environment, by field of `Chance`.

        No other part may take the same field.
        """
        return {}

    def check_stated(self, scenario: Scenario) -> None:
        """See that what it states of itself is what its role asks for.

        Parts from outside are asked when a scenario names them.

        Raises:
            InputError: it is something else.
        """

    def fault(self, message: str) -> InputError:
        """An error that says which part is at fault."""
        entry: Entry[Any] = self.settings.entry
        return entry.fault(message)

    def setup(self, world: Context) -> None:
        """Make ready to work in a world: tables and constants on its device."""
        self.world = world
        self.xp = world.backend.xp
