"""Random slots of random scenarios: in each the laws of physics and of the game are checked."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from campaigns.campaign import Campaign, Tally
from campaigns.scenarios_for_slots import draw_settings
from iout_marl import iout_v0
from iout_marl.core.limits import reward_bounds
from iout_marl.errors import InputError, Note
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.testing.recorded import permuted_chance
from iout_marl.world import ChanceStream, World, node_codes

#: Environments of a batch, at most, and scenarios that a short campaign sees at least.
MOST_ENVS, FEWEST_SCENARIOS = 4096, 8
#: Environments that are played a second time with their nodes in another order.
PERMUTED = 16


class LawBrokenError(AssertionError):
    """A law does not hold."""


def law(name: str, holds: Any) -> None:
    """Raise an error unless all flags are set."""
    if not np.all(holds):
        where = np.argwhere(~np.atleast_1d(holds))[0].tolist()
        raise LawBrokenError(f"{name}, at {where}")


def close(name: str, a: Any, b: Any, scale: Any = 0.0) -> None:
    """Raise an error unless two arrays are equal up to rounding of terms of that size."""
    law(name, np.abs(a - b) <= 1e-12 + 1e-9 * np.maximum(np.maximum(np.abs(a), np.abs(b)), scale))


class Laws:
    """What must hold in every slot of a world."""

    def __init__(self, world: World) -> None:
        self.world, self.scenario = world, world.scenario
        self.cells = world.grid.coordinate_table()
        self.is_cell = np.zeros(world.grid.num_codes, dtype=bool)
        self.is_cell[world.grid.encode(world.grid.all_coordinates())] = True
        self.env = np.arange(world.num_envs)[:, None]
        self.bound = sum(reward_bounds(world.scenario).values())
        self.one_cell = world.grid.num_cells == 1
        self.store = world.scenario.storage.model_dump()
        self.pairs = np.triu_indices(world.num_auvs, 1)
        self.is_continuous = world.scenario.age.sampling == "packet_start"
        self.slots, self.steps_a_slot = self._pace()

    def _pace(self) -> tuple[Any, Any]:
        """Of each direction: slots that a move takes, and steps that are made in one."""
        steps = self.world.motion.steps
        ones = np.ones(len(steps), dtype=int)
        if self.scenario.episode.slot_s is None:
            return ones, ones
        far_m = np.sqrt(((steps * np.array(self.scenario.grid.edges_m)) ** 2).sum(-1))
        slots_a_step = far_m / (self.scenario.auvs.speed_m_per_s * self.scenario.slot_s)
        moves = far_m > 0
        slots = np.where(moves, np.ceil(slots_a_step - 1e-9), 1)
        per_slot = np.where(moves, np.floor(1 / np.where(moves, slots_a_step, 1) + 1e-9), 1)
        return np.maximum(slots, 1).astype(int), np.maximum(per_slot, 1).astype(int)

    def begin(self, state: Any) -> None:
        """In the first state."""
        self._placed(state)
        law("energies at the start", state.energy_j == self.store.get("initial_j", 0.0))
        law("an age at the start", state.age == self.scenario.age.initial)
        self._seen(state)

    def slot(self, before: Any, action: Any, after: Any, events: Any, mask: Any) -> None:
        """In a slot, from one state to the next."""
        law("a slot is counted", after.slot == before.slot + 1)
        law("nodes lie still", after.node_cell == before.node_cell)
        self._moves(before, action, after, events)
        self._harvests(after, events)
        self._energies(before, after, events)
        if self.scenario.uplink.part.loses:
            self._losses(before, after, events)
        self._uplinks(before, after, events, mask)
        self._ages(before, after, events)
        self._seen(after)
        reward = self.world.reward(after, events)
        law("a reward is finite and within its bounds", np.abs(reward) <= self.bound)

    def _placed(self, state: Any) -> None:
        for cell in (state.cell, state.node_cell):
            law("cells lie in the grid", (cell >= 0) & (cell < len(self.is_cell)))
            law("codes are cells", self.is_cell[cell])
        separation = self.scenario.auvs.separation_cells
        if separation > 0 and self.world.num_auvs > 1:
            first, second = (self.cells[state.cell[:, auvs]] for auvs in self.pairs)
            apart = ((first - second) ** 2).sum(-1)
            law("AUVs keep their separation", apart >= separation**2 * (1 - 1e-9))

    def _moves(self, before: Any, action: Any, after: Any, events: Any) -> None:
        self._placed(after)
        old, new = self.cells[before.cell], self.cells[after.cell]
        direction, under_way = action[..., 0], np.zeros(before.cell.shape, dtype=bool)
        takes_slots = bool((self.slots > 1).any())
        if takes_slots:
            under_way = before.transit_slots > 0
            direction = np.where(under_way, before.course, direction)
        step = self.world.motion.steps[direction]
        way = [old]
        for done in range(int(self.steps_a_slot.max()) if not self.one_cell else 1):
            ahead = way[-1] + step
            goes = ((ahead >= 0) & (ahead < self.scenario.grid.cells)).all(-1)
            goes &= done < self.steps_a_slot[direction]
            way.append(np.where(goes[..., None], ahead, way[-1]))
            if not (way[-1] != way[-2]).any():
                break
        target = way[-1]
        inside = ((old + step >= 0) & (old + step < self.scenario.grid.cells)).all(-1)
        stays, arrives = (new == old).all(-1), (new == target).all(-1)
        law("a move leads along its way", np.any([(new == cell).all(-1) for cell in way], axis=0))
        law("who would leave the grid stays", inside | stays)
        slots = np.where((target == old).all(-1), 1, self.slots[direction])
        halted, left = np.zeros_like(inside), np.zeros(before.cell.shape, dtype=int)
        if self.world.vehicle.is_limited:
            halted = self._halted(before, events, old, target, slots)
        if takes_slots:
            left = np.where(halted, 1, np.where(under_way, before.transit_slots, slots)) - 1
            law("slots under way are counted down", after.transit_slots == left)
            law("who is under way is in its old cell", (left == 0) | stays)
            law("a course is kept", (left == 0) | (after.course == direction))
        if self.world.vehicle.is_limited:
            heading = np.where(left[..., None] > 0, target, new)
            self._batteries(before, after, events, self._move_j(old, heading, slots))
        leaves = ~inside & ~halted & (not self.one_cell)
        law("leaving the grid is noticed", events.left_grid == leaves)
        law("who is blocked does not arrive", ~events.blocked | ~arrives)
        law("who cannot pay for a move stays", ~halted | stays)
        law("who is not blocked arrives", events.blocked | halted | (left > 0) | arrives)

    def _move_j(self, old: Any, to: Any, slots: Any) -> Any:
        """Energy of a slot of the moves, (envs, auvs) in J."""
        hull, slot_s = self.scenario.vehicle, self.scenario.slot_s
        far_m = (to - old) * np.array(self.scenario.grid.edges_m)
        speed = np.sqrt((far_m**2).sum(-1)) / slot_s / slots
        drag = 0.5 * 1025 * hull.drag_coefficient * hull.drag_area_m2
        return drag * speed**3 / hull.propulsion_efficiency * slot_s

    def _halted(self, before: Any, events: Any, old: Any, target: Any, slots: Any) -> Any:
        """Who cannot move, (envs, auvs) bool."""
        hotel_j = self.scenario.vehicle.hotel_w * self.scenario.slot_s
        stranded = (before.battery_j < hotel_j) | (before.battery_j == 0)
        law("who is stranded", events.stranded == stranded)
        return stranded | (before.battery_j - hotel_j < self._move_j(old, target, slots))

    def _batteries(self, before: Any, after: Any, events: Any, move_j: Any) -> None:
        hull, nobody = self.scenario.vehicle, self.world.num_nodes
        stranded = events.stranded
        law("a battery holds no less than nothing", after.battery_j >= 0)
        law("a battery holds no more than it can", after.battery_j <= hull.capacity_j)
        law("who is stranded is counted", after.stranded_slots == before.stranded_slots + stranded)
        idle = (events.charged == nobody) & (events.heard == nobody)
        law("who is stranded names nobody", ~stranded | idle)
        close("propulsion", after.propulsion_j, before.propulsion_j + move_j, move_j)
        spent = ("propulsion_j", "hotel_j", "charging_j")
        drawn_j = sum(getattr(after, name) - getattr(before, name) for name in spent)
        whole_j = hull.capacity_j + after.docked_j
        close("what is drawn", events.drawn_j, drawn_j, whole_j + drawn_j)
        gone_j = sum(getattr(after, name) for name in spent) + after.battery_j
        initial_j = hull.initial_share * hull.capacity_j
        close("batteries", gone_j, initial_j + after.docked_j, whole_j)

    def _harvests(self, after: Any, events: Any) -> None:
        link, nobody = self.world.link, self.world.num_nodes
        # Nobody harvests nothing and spends nothing: which node stands for it does not matter.
        charged = np.minimum(events.charged, nobody - 1)
        offset = link.offset(after.cell, np.take_along_axis(after.node_cell, charged, 1))
        most_w = least_w = link.harvested_w[offset]
        if self.world.fades:
            gain_db = np.take_along_axis(after.gain_db, charged[..., None], 2)[..., 0]
            loss_db = link.charging_loss_db[offset] - gain_db
            most_w, least_w = (
                link.budget.harvested_after_loss_w(loss_db + db) for db in (0.0, 0.0011)
            )
            # Far from the median a harvest rises no further.
            least_w = np.minimum(least_w, link.most_harvested_w * (1 - 3e-4))
        lasts_s = link.slot_s * (events.charged < nobody)
        if self.scenario.duplex.kind == "tdd":
            low, high = self.scenario.duplex.beta_min, self.scenario.duplex.beta_max
            beta = events.beta
            law("β", (beta == 0) | (beta == 1) | ((beta >= low) & (beta <= high)))
            lasts_s = lasts_s * beta
        else:
            law("β in FDD", events.beta == 0)
        most_j, least_j = most_w * lasts_s, least_w * lasts_s
        law("what is harvested is no more", events.harvested_j <= most_j * (1 + 1e-9) + 1e-12)
        law("what is harvested is no less", events.harvested_j >= least_j * (1 - 1e-9) - 1e-12)

    def _losses(self, before: Any, after: Any, events: Any) -> None:
        nobody = self.world.num_nodes
        lost, excess_db = events.lost, events.excess_db
        law("what is lost is not delivered", ~(lost[..., 0] & events.delivered))
        law("what is lost is not delivered", ~(lost[..., 1:] & events.polled_delivered))
        law("what is lost was sent", ~lost[..., 0] | (events.spent_j > 0) | (events.beta > 0))
        law("who is lost was polled", ~lost[..., 1:] | (events.polled < nobody))
        arrived = np.concatenate([events.delivered[..., None], events.polled_delivered], axis=2)
        law("what is neither came to no ear", arrived | lost | (excess_db == 0))
        if self.scenario.uplink.loss.kind == "threshold":
            law("a threshold", (lost == (excess_db < -0.005)) | (abs(excess_db + 0.005) < 1e-9))
        counts = after.packets - before.packets
        weak = (lost & (excess_db < -0.005)).sum((1, 2))
        law("packets lost too weak are counted", counts[:, 1] == weak)
        law("packets lost are counted", counts[:, 1:].sum(-1) == lost.sum((1, 2)))
        law("packets sent are counted", counts[:, 0] >= (arrived | lost).sum((1, 2)))

    def _energies(self, before: Any, after: Any, events: Any) -> None:
        nobody = self.world.num_nodes
        charged, heard = (np.minimum(n, nobody - 1) for n in (events.charged, events.heard))
        law("nobody spends nothing", (events.heard < nobody) | (events.spent_j == 0))
        come_j = before.energy_j.copy()
        np.add.at(come_j, (self.env, charged), events.harvested_j)
        available_j = np.minimum(come_j, self.store.get("capacity_j", np.inf))
        close("charging adds what is harvested", available_j, events.available_j)
        spent_j = np.zeros_like(available_j)
        np.add.at(spent_j, (self.env, heard), events.spent_j)
        self._add_polled(spent_j, events, events.polled_j)
        law("energies are not negative", (after.energy_j >= 0).all(-1))
        law("nothing negative is spent", events.spent_j >= 0)
        left_j = available_j - spent_j
        lost_j = 0.0 * left_j
        if self.world.storage.is_limited:
            drain_j = (self.store["leakage_w"] + self.store["idle_w"]) * self.scenario.slot_s
            lost_j = np.minimum(np.maximum(left_j, 0.0), drain_j)
            losses = [s.leaked_j + s.idle_j for s in (before, after)]
            close("what leaks and idles", losses[1], losses[0] + lost_j, losses[1] + available_j)
            spilled_j = before.spilled_j + (come_j - available_j)
            close("what is spilled", after.spilled_j, spilled_j, spilled_j + come_j)
            asleep = (available_j == 0) & (self.store["idle_w"] > 0)
            law("who sleeps", after.asleep_slots == before.asleep_slots + asleep)
        close("an uplink takes what it spends", after.energy_j, left_j - lost_j, available_j)
        gone_j = (after.energy_j - self.store.get("initial_j", 0.0)).sum(-1) + after.spent_j
        for array in (after.spilled_j, after.leaked_j, after.idle_j):
            gone_j = gone_j + array.sum(-1)
        close(
            "harvested is spent, stored or lost",
            after.harvested_j,
            gone_j,
            (after.harvested_j + self.store.get("initial_j", 0.0)) * len(self.is_cell),
        )

    def _add_polled(self, totals: Any, events: Any, values: Any) -> None:
        """Add what was polled beside to (envs, nodes) totals."""
        for i in range(events.polled.shape[2]):
            is_one = events.polled[..., i] < self.world.num_nodes
            node = np.minimum(events.polled[..., i], self.world.num_nodes - 1)
            law("no poll brings nothing", is_one | (values[..., i] == 0))
            np.add.at(totals, (self.env, node), values[..., i])

    def _uplinks(self, before: Any, after: Any, events: Any, mask: Any) -> None:
        access, delivered = self.scenario.channel.access.kind, events.delivered
        num_nodes = self.world.num_nodes
        heard = np.minimum(events.heard, num_nodes - 1)
        law("nobody delivers nothing", (events.heard < num_nodes) | ~delivered)
        served = np.zeros_like(after.deliveries)
        np.add.at(served, (self.env, heard), delivered)
        self._add_polled(served, events, events.polled_delivered)
        law("a node delivers once", served <= 1)
        law("deliveries are counted", after.deliveries == before.deliveries + served)
        law("who delivers pays", ~delivered | (events.spent_j > 0) | (events.beta > 0))
        available_j = np.take_along_axis(events.available_j, heard, 1)
        law("no more is spent than there is", events.spent_j <= available_j * (1 + 1e-9))
        law("who only charges delivers nothing", ~delivered | (events.beta < 1))
        if access == "exclusive":
            law("one uplink in the network", delivered.sum(-1) <= 1)
        else:
            lost = events.lost[..., :1].any(-1)
            law("nothing is spent for nothing", delivered | lost | (events.spent_j == 0))
        if self.scenario.duplex.kind == "fdd":
            link = self.world.link
            heard_cell = np.take_along_axis(after.node_cell, heard, 1)
            price_j = link.slot_uplink_j[link.offset(after.cell, heard_cell)]
            law("an uplink is paid", ~delivered | (available_j > price_j))
            hears = mask[..., -self.world.action_sizes[-1] :]
            may = np.take_along_axis(hears, heard[..., None], 2)[..., 0]
            # Masks go by the median.
            law("what is masked could not have paid", may | ~delivered | self.world.fades)

    def _ages(self, before: Any, after: Any, events: Any) -> None:
        world, oldest = self.world, self.scenario.age.maximum
        served = after.deliveries > before.deliveries
        grown = np.minimum(before.age + 1, oldest)
        counted, highest = after.age, after.age
        if self.is_continuous:
            # The integral of an age that rises evenly to A_max at most, and where it ends.
            rises = np.minimum(oldest - before.age, 1)
            counted = before.age + rises - rises**2 / 2
            highest = before.age + rises
            law(
                "ages rise by one or fall below",
                np.where(served, after.age <= 1, after.age == grown),
            )
            law("no packet is from the future", after.age > 0)
        else:
            law("ages rise by one or fall to one", after.age == np.where(served, 1, grown))
            law("no age is below 1", after.age >= 1)
        law("no age is above A_max", after.age <= oldest)
        close("the mean age", after.mean_age, after.age.mean(-1))
        close("the sum of mean ages", after.age_sum, before.age_sum + counted.mean(-1))
        close("the peak age", after.peak_age, np.maximum(before.peak_age, highest.max(-1)))
        total = after.deliveries.sum(-1)
        jain = total**2 / np.maximum(world.num_nodes * (after.deliveries**2).sum(-1), 1)
        close("Jain's index", after.jain, jain)
        law("Jain's index lies in its range", (after.jain >= 0) & (after.jain <= 1 + 1e-12))

    def _seen(self, state: Any) -> None:
        observer = self.world.observer
        pairs = [
            (self.world.observe(state), observer.agent_ranges),
            (observer.observe_globally(state), observer.state_ranges),
            (
                observer.observe_for_critic(state, central=True),
                observer.critic_ranges(central=True),
            ),
        ]
        for seen, ranges in pairs:
            slack = 1e-9 * (1 + np.abs(ranges.high))
            law("an observation lies in its range", seen >= ranges.low - slack)
            law("an observation lies in its range", seen <= ranges.high + slack)
        for name, values in self.world.metrics(state).items():
            law(f"{name} is finite", np.isfinite(values))


def masked_actions(world: World, mask: Any, rng: np.random.Generator) -> Any:
    """An action that the mask allows for every AUV; of each entry any choice is as likely."""
    entries = np.split(mask, np.cumsum(world.action_sizes)[:-1], axis=-1)
    law("a mask leaves a choice", np.stack([entry.any(-1) for entry in entries]))
    chosen = [(entry * rng.random(entry.shape, np.float32)).argmax(-1) for entry in entries]
    return np.stack(chosen, axis=-1)


class Permuted:
    """The same environments with their nodes in another order."""

    def __init__(self, world: World, layout: Any, envs: int, rng: np.random.Generator) -> None:
        self.order = rng.permutation(world.num_nodes)
        self.place = np.append(np.argsort(self.order), len(self.order))  # nobody is nobody
        scenario = world.scenario
        if scenario.nodes.weights is not None:
            weights = tuple(scenario.nodes.weights[i] for i in self.order)
            nodes = scenario.nodes.model_copy(update={"weights": weights})
            scenario = scenario.model_copy(update={"nodes": nodes})
        self.world = World(scenario, envs)
        self.state = self.world.reset(layout[:envs][:, self.order])

    def compare(self, action: Any, chance: Any, after: Any, reward: Any) -> None:
        """Play a slot, and compare it."""
        envs = self.world.num_envs
        if chance is not None:
            chance = permuted_chance(chance.map(lambda array: array[:envs]), self.order)
        own = action[:envs].copy()
        own[..., 1:] = self.place[own[..., 1:]]
        self.state, events = self.world.step(self.state, own, chance)
        law("permuted: cells", self.state.cell == after.cell[:envs])
        law("permuted: ages", self.state.age == after.age[:envs][:, self.order])
        close("permuted: energies", self.state.energy_j, after.energy_j[:envs][:, self.order])
        scale = np.abs(reward[:envs]).max(initial=1.0)
        close("permuted: rewards", self.world.reward(self.state, events), reward[:envs], scale)


class Single:
    """The first environment, played by PettingZoo's form."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self.env = iout_v0.parallel_env(scenario)
        self.env.reset(seed=seed)

    def compare(self, action: Any, observation: Any, reward: Any, *, is_last: bool) -> None:
        """Play a slot, and compare it."""
        agents = self.env.agents
        own = {agent: action[0, i] for i, agent in enumerate(agents)}
        seen, rewards, _, truncations, infos = self.env.step(own)
        for i, agent in enumerate(agents):
            vector = seen[agent]
            vector = vector["observation"] if isinstance(vector, dict) else vector
            law("single: observations", vector == observation[0, i].astype(np.float32))
            space = self.env.observation_space(agent)
            law("single: observations lie in their space", space.contains(seen[agent]))
            close("single: rewards", np.float64(rewards[agent]), reward[0, i], 1.0)
            law("single: ends", truncations[agent] == is_last)
            numbers = [v for v in infos[agent].values() if isinstance(v, float)]
            law("single: infos are finite", np.isfinite(numbers))
        law("single: the state lies in its space", self.env.state_space.contains(self.env.state()))


def play_scenario(scenario: Scenario, num_envs: int, rng: np.random.Generator) -> int:
    """An episode in every environment; how many slots that were.

    In half of the environments every choice is one that the mask allows, in the others any.
    """
    world, seed = World(scenario, num_envs), int(rng.integers(2**31))
    laws = Laws(world)
    # Those after the first few take their layouts from one stream, which is faster.
    few = [np.random.default_rng(seed + i) for i in range(min(num_envs, PERMUTED))]
    streams = few + [few[-1]] * (num_envs - len(few))
    is_fixed = scenario.nodes.kind == "fixed"
    layout = node_codes(scenario, world.grid, few if is_fixed else streams)
    layout = np.tile(layout[:1], (num_envs, 1)) if is_fixed else layout
    state = world.reset(layout)
    # Of equally old nodes the first is polled first: their order matters.
    permuted = None if world.hearing.polls else Permuted(world, layout, len(few), rng)
    single = Single(scenario, seed)
    laws.begin(state)
    chances = ChanceStream(scenario, [np.random.default_rng(seed + i) for i in range(num_envs)])
    half = num_envs // 2
    for slot in range(world.num_slots):
        mask = world.action_mask(state)
        shape = (num_envs, world.num_auvs)
        action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], axis=-1)
        # Charging and hearing one node by several AUVs is rare otherwise.
        if slot % 3 == 0 and world.num_nodes > 1:
            action[..., 1:] = np.minimum(action[..., 1:], 1)
        action[half:] = masked_actions(world, mask[half:], rng)
        chance = next(chances)
        after, events = world.step(state, action, chance)
        law("a masked move stays in the grid", ~events.left_grid[half:])
        laws.slot(state, action, after, events, mask)
        reward = world.reward(after, events)
        if permuted is not None:
            permuted.compare(action, chance, after, reward)
        is_last = slot == world.num_slots - 1
        single.compare(action, world.observe(after), reward, is_last=is_last)
        state = after
    return num_envs * world.num_slots


def run(rng: np.random.Generator, cases: int) -> Tally:
    """Play so many slots."""
    tally, played, refused = Tally(), 0, 0
    while played < cases and len(tally.faults) < 20:
        name, settings = draw_settings(rng)
        try:
            scenario = load_scenario(name, settings)
        except InputError:
            # AUVs that find no room, say: they must not be all.
            refused += 1
            if refused > 50 + played:
                tally.fault(settings, "most scenarios are refused")
            continue
        envs = cases // (FEWEST_SCENARIOS * scenario.num_slots)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                # What should be known of results is no fault of them.
                warnings.simplefilter("ignore", Note)
                count = play_scenario(scenario, int(np.clip(envs, 4, MOST_ENVS)), rng)
        except Exception as error:  # whatever it is, it is the fault that is looked for
            tally.fault((name, settings), error)
            continue
        played += count
        kind = settings["duplex"]["kind"]
        tally.note(f"{kind}, {scenario.channel.access.kind}", count)
    return tally


CAMPAIGN = Campaign("random slots", cases=20_000_000, short=20_000, run=run)
