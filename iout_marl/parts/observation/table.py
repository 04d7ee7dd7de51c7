"""Observations as tables: a row for each node and each other AUV."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from iout_marl.parts.observation.base import representations
from iout_marl.parts.observation.scaled import Scaled
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import Plausible, Positive
from iout_marl.scenario.parts import PartOf
from iout_marl.scenario.parts import Settings as PartSettings


@representations.register("table")
class Table(Scaled):
    """A row of numbers for each node, one for each other AUV, and what belongs to no row.

    All of them are relative to the AUV and in units of what is needed, so that they mean the same
    in any network: networks of any size can share a policy (`training.network: set`). Entries of
    one's own, and the state for central critics, are written as by `scaled`.
    """

    class Settings(PartSettings):
        #: What environments hand out: `rows`, a Dict of `context`, `nodes` and, beside other AUVs,
        #: `auvs`; or `flat`, one vector with all of it. Training here takes no notice of it.
        form: Literal["rows", "flat"] = "rows"
        #: Distance up to which an AUV knows a node's age and energy; those of a node farther away
        #: are what they were when it last was near or delivered to this AUV. null: everything is
        #: known to all.
        view_range_m: Annotated[Positive, Plausible(0, 1e7, "m")] | None = None
        #: Entries of one's own, as further columns of the rows that they are for.
        entries: Annotated[
            tuple[Annotated[PartSettings, PartOf("observation entry", is_word=True)], ...],
            Field(strict=False, max_length=100),
        ] = ()
        #: Where the mask of sensible actions is handed out, if at all.
        action_mask: Literal["none", "info", "observation"] = "none"

        hash_defaults: ClassVar[dict[str, Any]] = {"form": "rows"}

    settings: Settings  # type: ignore[assignment] # of what all tables have, nothing is chosen
    is_table = True
    sees_others = True

    @property
    def is_by_rows(self) -> bool:
        return self.settings.form == "rows"

    def kinds(self, scenario: Scenario) -> list[str]:  # noqa: ARG002
        unseen = ["unseen_for"] if self.settings.view_range_m is not None else []
        return [
            *("walls", "fleet", "progress"),
            "companions",
            *("bearings", "urgency", "affordability", "rivals", *unseen),
            "prospects",
        ]
