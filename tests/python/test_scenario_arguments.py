"""Whatever takes a scenario takes a name, a path, a mapping or a `Scenario`, and overrides."""

import importlib
import inspect
import pathlib

import gymnasium
import pettingzoo
import pytest
from tiny_study import TINY

import iout_marl
import trainers
from iout_marl import (
    InputError,
    Scenario,
    World,
    bounds,
    envs,
    iout_v0,
    load_scenario,
    parts,
    testing,
)
from iout_marl.envs import AUVEnv, AUVParallelEnv, AUVVectorEnv
from iout_marl.scenario import to_yaml

#: Where what is documented is imported from.
PUBLIC = ("iout_marl", "iout_marl.iout_v0", "iout_marl.envs", "iout_marl.bounds",
          "iout_marl.testing", "trainers")  # fmt: skip
#: Slots of an episode, by the scenario and by an override: what tells that both have arrived.
SLOTS, FEWER = 20, 7
OVERRIDES = {"episode.duration_s": FEWER * 25.0}


def slots_of_copies(vec_env):
    vec_env.reset()
    actions = [vec_env.action_space.sample() * 0] * vec_env.num_envs
    for slots in range(1, 2 * SLOTS):
        if vec_env.step(actions)[2][0]:
            return slots
    return None


def slots_by_age(age_sum, scenario, overrides):
    """Slots of an episode, once a bound is what it is for the loaded scenario."""
    loaded = load_scenario(scenario, overrides)
    assert age_sum == bounds.least_age_sum(loaded)
    return loaded.num_slots


def trained(scenario, folder, overrides):
    few = {**dict(overrides or {}), "training.steps": 80}
    outcome = trainers.train(scenario, folder, overrides=few, evaluation_episodes=1)
    return outcome.trainer.scenario.num_slots


def evaluated_slots(scenario, overrides):
    seen = []
    iout_marl.evaluate(scenario, lambda o: seen.append(o) or o[..., :3].astype(int) * 0, 1,
                       overrides=overrides)  # fmt: skip
    return len(seen)


def checked_slots(scenario, overrides):
    seen = []

    class Mine(parts.Reward):
        def check(self, scenario):
            seen.append(scenario.num_slots)

        def __call__(self, state, events):
            return {"age": -state.mean_age[:, None]}

    parts.rewards.register("mine", version=1)(Mine)
    try:
        testing.check_part("reward", "mine", scenario=scenario, overrides=overrides, seeds=[0])
    finally:
        parts.rewards.unregister("mine")
    return seen[-1]


#: Of each, the slots of an episode of the scenario that it has made of its arguments.
TAKES = {
    "iout_marl.World": lambda s, o, _: World(s, overrides=o).num_slots,
    "iout_marl.evaluate": lambda s, o, _: evaluated_slots(s, o),
    "iout_marl.record_episode": lambda s, o, _: len(
        iout_marl.record_episode(s, "greedy", overrides=o).ages
    ),
    "iout_marl.record_policy": lambda s, o, _: iout_marl.record_policy(
        s, "greedy", overrides=o
    ).slots,
    "iout_marl.bound": lambda s, o, _: slots_by_age(
        iout_marl.bound(s, seconds=0, overrides=o).scheduling
        * 2 * load_scenario(s, o).num_slots, s, o),
    "iout_marl.train": lambda s, o, folder: trained(s, folder, o),
    "iout_marl.Trainer": lambda s, o, _: trainers.Trainer(s, overrides=o).scenario.num_slots,
    "iout_marl.load_scenario": lambda s, o, _: load_scenario(s, o).num_slots,
    "iout_marl.iout_v0.parallel_env": lambda s, o, _: iout_v0.parallel_env(
        s, overrides=o
    ).scenario.num_slots,
    "iout_marl.iout_v0.raw_env": lambda s, o, _: iout_v0.raw_env(
        s, overrides=o
    ).unwrapped.scenario.num_slots,
    "iout_marl.iout_v0.env": lambda s, o, _: iout_v0.env(
        s, overrides=o
    ).unwrapped.scenario.num_slots,
    "iout_marl.envs.AUVEnv": lambda s, o, _: AUVEnv(s, overrides=o).scenario.num_slots,
    "iout_marl.envs.AUVParallelEnv": lambda s, o, _: AUVParallelEnv(
        s, overrides=o
    ).scenario.num_slots,
    "iout_marl.envs.AUVVectorEnv": lambda s, o, _: AUVVectorEnv(
        s, 2, overrides=o
    ).scenario.num_slots,
    "iout_marl.envs.sb3_vec_env": lambda s, o, _: slots_of_copies(
        envs.sb3_vec_env(s, 2, overrides=o)
    ),
    "iout_marl.envs.supersuit_vec_env": lambda s, o, _: slots_of_copies(
        envs.supersuit_vec_env(s, 2, overrides=o)
    ),
    "iout_marl.bounds.least_age_sum": lambda s, o, _: slots_by_age(
        bounds.least_age_sum(s, overrides=o), s, o
    ),
    "iout_marl.bounds.delivery_bound": lambda s, o, _: slots_by_age(
        bounds.delivery_bound(s, overrides=o) * 2 * load_scenario(s, o).num_slots, s, o
    ),
    "iout_marl.bounds.verified_age_sum": lambda s, o, _: slots_by_age(
        bounds.verified_age_sum(
            s, bounds.bound(load_scenario(s, o), seconds=0).certificate, overrides=o
        ), s, o),
    "iout_marl.testing.check_part": lambda s, o, _: checked_slots(s, o),
    "gymnasium.make": lambda s, o, _: gymnasium.make(
        "iout_marl:AUV-v0", scenario=s, overrides=o
    ).unwrapped.scenario.num_slots,
    "gymnasium.make_vec": lambda s, o, _: gymnasium.make_vec(
        "iout_marl:AUV-v0", 2, "vector_entry_point", scenario=s, overrides=o
    ).unwrapped.scenario.num_slots,
    "pettingzoo.make": lambda s, o, _: pettingzoo.make(
        "parallel", "iout/AUV-v0", scenario=s, overrides=o
    ).unwrapped.scenario.num_slots,
}  # fmt: skip
#: The same by other names.
ALIASES = {"iout_marl.bounds.bound": "iout_marl.bound", "trainers.train": "iout_marl.train",
           "trainers.Trainer": "iout_marl.Trainer"}  # fmt: skip


def public_callables():
    for place in PUBLIC:
        module = importlib.import_module(place)
        for name in getattr(module, "__all__", None) or vars(module):
            found = getattr(module, name)
            is_own = callable(found) and getattr(found, "__module__", "").startswith(
                ("iout_marl", "trainers")
            )
            if not name.startswith("_") and is_own:
                yield f"{place}.{name}", found


def test_the_list_is_complete():
    """Data classes apart, whose `scenario` is that of a record."""
    taking = set()
    for name, found in public_callables():
        takes = (
            name == "iout_marl.load_scenario" or "scenario" in inspect.signature(found).parameters
        )
        if takes and not hasattr(found, "__dataclass_fields__"):
            taking.add(name)
    ours = {name for name in TAKES if name.startswith("iout_marl")}
    helpers = {"iout_marl.iout_v0.scenario_of", "iout_marl.iout_v0.AUVParallelEnv"}
    assert taking - helpers == ours | set(ALIASES)


def by_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return "small"


FORMS = {
    "name": by_name,
    "path": lambda tmp_path, _: tmp_path / "small.yaml",
    "mapping": lambda *_: {"extends": "paper/k3-fdd", **nested(TINY)},
    "Scenario": lambda *_: load_scenario("paper/k3-fdd", TINY),
}


def nested(settings):
    sections = {}
    for key, value in settings.items():
        section, _, name = key.partition(".")
        sections.setdefault(section, {})[name] = value
    return sections


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("taker", TAKES)
# Of a grid of one layer, whose cells have one depth.
@pytest.mark.filterwarnings("ignore:.*A Box observation space maximum and minimum values are equal")
def test_every_form_and_overrides(taker, form, tmp_path, monkeypatch):
    (tmp_path / "small.yaml").write_text(to_yaml(load_scenario("paper/k3-fdd", TINY)))
    scenario = FORMS[form](tmp_path, monkeypatch)
    take = TAKES[taker]
    assert take(scenario, None, tmp_path / "run") == SLOTS
    assert take(scenario, OVERRIDES, tmp_path / "again") == FEWER


@pytest.mark.parametrize("taker", TAKES)
def test_a_fault_in_either_gets_one_line(taker, tmp_path):
    for scenario, overrides in (("paper/k3-fd", None), ("paper/k3-fdd", {"auvs.cuont": 2})):
        with pytest.raises(InputError, match=r"did you mean") as raised:
            TAKES[taker](scenario, overrides, tmp_path / "run")
        assert str(raised.value).isprintable()


def test_a_scenario_without_overrides_comes_back_as_it_is():
    scenario = load_scenario("paper/k3-fdd")
    for nothing in ((), None, {}, []):
        assert load_scenario(scenario, nothing) is scenario
    assert isinstance(load_scenario(scenario, OVERRIDES), Scenario)
    assert load_scenario(scenario, OVERRIDES) != scenario


def test_overrides_are_of_any_kind():
    for overrides in ("auvs.count=3", ["auvs.count=3"], {"auvs.count": 3}, {"auvs": {"count": 3}}):
        assert iout_v0.parallel_env("paper/k3-fdd", overrides=overrides).max_num_agents == 3
    env = iout_v0.parallel_env("paper/k3-fdd", None, 9, overrides={"auvs.count": 2})
    assert (env.scenario.num_slots, env.max_num_agents) == (9, 2)
    assert env.scenario == load_scenario(
        "paper/k3-fdd", {"auvs.count": 2, "episode.duration_s": 9 * env.scenario.slot_s}
    )


def test_paths_of_any_kind(tmp_path):
    (tmp_path / "small.yaml").write_text(to_yaml(load_scenario("paper/k3-fdd", TINY)))
    for path in (pathlib.PurePath(tmp_path, "small"), str(tmp_path / "small.yaml")):
        assert World(path).num_slots == SLOTS
