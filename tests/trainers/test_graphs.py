"""Captured training is eager training: as CUDA graphs, and as their emulation on the CPU."""

import io
import itertools
import pickle
import types

import pytest
import torch
from emulated_graph import EmulatedGraph, MemoryGoneError
from seas import OF_ANY
from test_accelerator import SHORT, TWO_AUVS, assert_alike, needs_cuda
from test_accelerator import VARIANTS as ON_ACCELERATORS
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten

from iout_marl.errors import InputError
from trainers import Trainer, collector
from trainers.accel import graphs
from trainers.accel.graphs import CapturedFunction
from trainers.accel.group import ProcessGroup
from trainers.networks import ActorCritic
from trainers.optimizers import Adam
from trainers.timing import PhaseTimer

VARIANTS = {
    "a changing sea": OF_ANY,
    **ON_ACCELERATORS,
    "episodes across rollouts, all that is running": {
        "nodes": {"kind": "random", "count": 2},
        "training.rollout_slots": 17,
        "training.minibatches": 3,
        "training.learning_rate_schedule": "linear",
        "training.observation_scaling": "running",
        "training.reward_scaling": "running",
    },
    "short rollouts, nothing scaled": {
        "reward.kind": "paper",
        "training.rollout_slots": 7,
        "training.learning_rate_schedule": "constant",
        "training.observation_scaling": "none",
        "training.reward_scaling": "none",
        "training.normalise_value": False,
        "training.normalise_advantage": False,
    },
    "limited view, interference while charging, running inputs of a central critic": {
        **TWO_AUVS,
        "duplex.kind": "tdd",
        "channel.access": "interference",
        "auvs.separation_cells": 1,
        "observation.view_range_m": 100,
        "observation.other_auvs": True,
        "training.mask_actions": True,
        "training.critic": "central",
        "training.observation_scaling": "running",
        "training.rollout_slots": 13,
    },
    "epochs that stop early": {"training.target_kl": 0.001, "training.rollout_slots": 13},
}
VARIANTS = {name: {**SHORT, **changes} for name, changes in VARIANTS.items()}

#: Policies side by side cannot stop their epochs apart.
SIDE_BY_SIDE = {
    n: changes for n, changes in VARIANTS.items() if "training.target_kl" not in changes
}
RECORDED = [
    pytest.param(changes, replicas, id=f"{name}, {replicas}")
    for name, changes in SIDE_BY_SIDE.items()
    for replicas in (1, 2)
]
CASES = [*((changes, 1) for changes in VARIANTS.values()), *((c, 2) for c in SIDE_BY_SIDE.values())]


@pytest.fixture(params=VARIANTS.values(), ids=list(VARIANTS))
def scenario(request, tiny):
    return tiny(request.param)


@pytest.fixture
def on_torch(monkeypatch):
    monkeypatch.setattr(collector, "NUMPY_DEVICES", ())


@pytest.fixture
def emulated(monkeypatch, on_torch):
    """All graphs that were made."""
    made = []

    def graph(device):
        made.append(EmulatedGraph(device))
        return made[-1]

    monkeypatch.setitem(graphs.GRAPHS, "cpu", graph)
    return made


def iterated(trainer, times):
    """The logs, but for how fast it went."""
    logs = [log for _ in range(times) for log in trainer.iterate_all()]
    return [{k: v for k, v in log.items() if not k.startswith("speed/")} for log in logs]


def everything(trainer):
    """All that training continues from."""
    return tree_flatten([trainer.state_dict(i) for i in range(len(trainer.seeds))])[0]


def assert_equal(first, second):
    for a, b in zip(everything(first), everything(second), strict=True):
        assert torch.equal(a, b) if isinstance(a, torch.Tensor) else a == b


def eager_and_recorded(scenario, emulated, replicas=1):
    """Two trainers, found alike after four iterations; a state after one, and the logs since."""
    eager = Trainer(scenario, 3, replicas=replicas, use_graphs=False)
    first, middle = iterated(eager, 1), eager.state_dict()
    since = iterated(eager, 3)
    assert not emulated
    recorded = Trainer(scenario, 3, replicas=replicas)
    assert iterated(recorded, 4) == first + since
    assert_equal(recorded, eager)
    slots = scenario.training.rollout_slots
    # The first call of each is no replay; early stops are not recorded.
    learns = [3] if scenario.training.target_kl is None else []
    assert [graph.replays for graph in emulated] == [4 * slots - 1, 3, *learns]
    return eager, recorded, middle, since


@pytest.mark.slow
def test_recorded_training_is_eager_training_and_goes_on_from_any_state(scenario, emulated):
    eager, used, middle, expected = eager_and_recorded(scenario, emulated)
    fresh = Trainer(scenario, 5)
    # The first call is none of a graph, the second one records it, the third one repeats it.
    for trainer in (fresh, used):
        trainer.load_state_dict(middle)
        assert iterated(trainer, 3) == expected
        assert torch.equal(trainer.weights()["actor.0.weight"], eager.weights()["actor.0.weight"])
    eager.load_state_dict(used.state_dict())
    assert iterated(eager, 1) == iterated(used, 1)


@pytest.mark.slow
@pytest.mark.parametrize("changes", SIDE_BY_SIDE.values(), ids=list(SIDE_BY_SIDE))
def test_recorded_policies_side_by_side_are_eager_ones(tiny, emulated, changes):
    eager_and_recorded(tiny(changes), emulated, replicas=2)


@pytest.mark.slow
def test_rollouts_of_other_lengths_do_not_disturb_what_is_recorded(tiny, emulated):
    trainers = [Trainer(tiny(), 3, use_graphs=use) for use in (False, True)]
    for trainer in trainers:
        for slots in (7, 20, 7, 1):
            trainer.collector.collect(trainer.network, slots, use_mask=False)
            trainer.iterate()
    assert_equal(*trainers)


def test_metrics_of_episodes_outlive_the_next_rollout(tiny, emulated):
    trainer = Trainer(tiny())
    first = trainer.collector.collect(trainer.network, 20, use_mask=False)
    (metrics,), terms = first.episodes, first.reward_terms
    before = {k: v.item() for k, v in {**metrics, **terms}.items()}
    second = trainer.collector.collect(trainer.network, 20, use_mask=False)
    assert second.inputs is first.inputs
    assert before == {k: v.item() for k, v in {**metrics, **terms}.items()}
    assert before["mean_aoi"] != second.episodes[0]["mean_aoi"].item()


@pytest.mark.usefixtures("emulated")
def test_processes_of_a_group_record_nothing(tiny):
    group = ProcessGroup()
    group.size = 2
    trainer = Trainer(tiny(), group=group)
    assert not trainer.runtime.captures


def test_world_on_numpy_is_not_recorded(tiny, monkeypatch):
    monkeypatch.setitem(graphs.GRAPHS, "cpu", EmulatedGraph)
    trainers = [Trainer(tiny(), 3, use_graphs=use) for use in (False, True)]
    assert iterated(trainers[0], 3) == iterated(trainers[1], 3)


# What is not in a graph shows in its emulation.


@pytest.mark.slow
def test_a_number_of_python_stays_what_it_was_when_recorded(tiny, monkeypatch, emulated):
    step, calls = Adam.step, itertools.count(1)
    monkeypatch.setattr(Adam, "step", lambda adam, row, rate: step(adam, row, 1e-3 * next(calls)))
    eager, recorded = Trainer(tiny(), 3, use_graphs=False), Trainer(tiny(), 3)
    for trainer, alike in ((eager, None), (recorded, [True, True, False])):
        calls = itertools.count(1)
        found = [trainer.iterate() and trainer.weights()["actor.0.weight"] for _ in range(3)]
        if alike is None:
            expected = found
        else:
            assert [torch.equal(*pair) for pair in zip(found, expected, strict=True)] == alike


def test_recording_has_no_effect_and_each_call_has_one():
    total = torch.zeros(())
    add = CapturedFunction(lambda x: total.add_(x) * 2, EmulatedGraph, None)
    results = [add(torch.tensor(x)) for x in (1.0, 2.0, 3.0)]
    assert total == 6
    assert results[1] is results[2]
    assert results[2] == 12


def test_a_name_that_leads_elsewhere_is_not_followed():
    counts = [torch.zeros(())]

    def count():
        counts.append(counts[-1] + 1)
        return counts[-1]

    counting = CapturedFunction(count, EmulatedGraph, None)
    assert [counting().item() for _ in range(4)] == [1, 2, 2, 2]


def test_memory_that_was_given_back_is_missed():
    kept = {"now": torch.zeros(3)}
    recorded = CapturedFunction(lambda: kept["now"] + 1, EmulatedGraph, None)
    recorded(), recorded(), recorded()
    kept["now"] = torch.zeros(3)
    with pytest.raises(MemoryGoneError):
        recorded()


@pytest.mark.parametrize(
    ("refused", "why"),
    [
        (lambda x: x + torch.tensor([1.0, 2.0]), "lift_fresh"),
        (lambda x: x[[0]], "lift_fresh"),
        (lambda x: x * x.sum().item(), "_local_scalar_dense"),
        (lambda x: x[x > 0], "aten::index"),
        (lambda x: x + torch.rand(2), "rand"),
        (lambda x: x.normal_(), "normal_"),
        (lambda x: torch.bincount(x.long()), "bincount"),
    ],
    ids=["numbers", "indices", "a number asked for", "a mask", "noise", "in place", "counts"],
)
def test_what_a_graph_cannot_hold_is_refused(refused, why):
    recorded, x = CapturedFunction(refused, EmulatedGraph, None), torch.ones(2)
    recorded(x)
    with pytest.raises(InputError, match=f"CUDA graphs .*{why}.*; --no-graphs trains without"):
        recorded(x)


def test_what_made_a_recording_fail_is_told():
    class Failing(EmulatedGraph):
        def capture(self, function):
            try:
                return super().capture(function)
            finally:
                raise RuntimeError("operation failed due to a previous error during capture")

    recorded, x = CapturedFunction(lambda x: x[x > 0], Failing, None), torch.ones(2)
    recorded(x)
    with pytest.raises(InputError, match="aten::index"):
        recorded(x)


def test_a_first_call_that_was_interrupted_is_made_again():
    calls = []

    def interrupted_once(x):
        calls.append(x)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return x + 1

    graphs_made = []

    def new_graph(device):
        graphs_made.append(EmulatedGraph(device))
        return graphs_made[-1]

    recorded = CapturedFunction(interrupted_once, new_graph, None)
    with pytest.raises(KeyboardInterrupt):
        recorded(torch.zeros(()))
    assert [recorded(torch.tensor(float(x))).item() for x in (1, 2, 3)] == [2, 3, 4]
    assert graphs_made[-1].replays == 2


@pytest.mark.slow
def test_a_state_that_was_loaded_lies_in_memory_as_a_fresh_one(tiny, emulated):
    trainer = Trainer(tiny(), 3)
    fresh = trainer.collector.state.map(lambda tensor: tensor.stride())
    iterated(trainer, 2)
    kept = trainer.collector.state
    trainer.load_state_dict(trainer.state_dict())
    assert trainer.collector.state is kept
    assert trainer.collector.state.map(lambda tensor: tensor.stride()) == fresh


# What is recorded works on the device alone. Tensors of the device `meta` have no numbers, but
# a place of their own, and tell where those of the CPU come in.

META = torch.device("meta")


class Elsewhere(pickle.Pickler):
    """Copies an object, its tensors as tensors of `META`."""

    WHOLE = (
        types.ModuleType,
        types.FunctionType,
        types.BuiltinFunctionType,
        torch.Generator,
        torch.dtype,
    )

    def __init__(self):
        self.file, self.kept, self.places = io.BytesIO(), [], {}
        super().__init__(self.file)

    def persistent_id(self, value):
        if not isinstance(value, (torch.Tensor, torch.device, *self.WHOLE)):
            return None
        if id(value) not in self.places:
            self.places[id(value)] = len(self.kept)
            self.kept.append(self.moved(value))
        return self.places[id(value)]

    def moved(self, value):
        if isinstance(value, torch.nn.Parameter):
            return torch.nn.Parameter(torch.empty_like(value, device=META))
        if isinstance(value, torch.Tensor):
            return torch.empty_like(value, device=META)
        return META if isinstance(value, torch.device) else value

    def copy(self, value):
        self.dump(value)
        self.file.seek(0)
        unpickler = pickle.Unpickler(self.file)
        unpickler.persistent_load = self.kept.__getitem__
        return unpickler.load()


class StaysThere(TorchDispatchMode):
    """Fails where a tensor of another device than `META` comes in or out."""

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        results = func(*args, **(kwargs or {}))
        for tensor in tree_flatten((args, kwargs, results))[0]:
            if isinstance(tensor, torch.Tensor):
                assert tensor.device == META, f"{func} works on {tensor.device}"
        return results


def work_elsewhere(scenario, replicas):
    """Does all that is recorded once, on `META`."""
    trainer = Trainer(scenario, 3, replicas=replicas, use_graphs=False)
    trainer.iterate_all()
    settings = trainer.settings
    storage, _ = trainer.collector._allocate(
        trainer.network, settings.rollout_slots, use_mask=settings.mask_actions, is_shown=False
    )
    orders = torch.stack(
        list(trainer.turn.minibatches.orders(settings.rollout_slots, settings.epochs))
    )
    rate = torch.zeros((), dtype=torch.float64)
    trainer, storage, orders, rate = Elsewhere().copy((trainer, storage, orders, rate))
    collecting, network = trainer.collector, trainer.network
    with StaysThere():
        with torch.no_grad():
            row, timer = storage.row, PhaseTimer()
            collecting._set_state(collecting._collect_slot(network, storage, row, timer))
            collecting._collect_slot(network, storage, row, timer)
            collecting._compute_values(network, storage.rollout)
        figures = trainer._update(storage.rollout, orders, rate)
    assert len(figures) == 8


@pytest.mark.slow
@pytest.mark.usefixtures("on_torch")
@pytest.mark.parametrize(("changes", "replicas"), RECORDED)
def test_nothing_recorded_reaches_for_the_memory_of_the_host(tiny, changes, replicas):
    work_elsewhere(tiny(changes), replicas)


@pytest.mark.usefixtures("on_torch")
def test_the_check_for_memory_of_the_host_can_fail(tiny, monkeypatch):
    sample = ActorCritic.sample
    monkeypatch.setattr(
        ActorCritic, "sample", lambda _, p, noise: sample(p, noise * torch.ones(()))
    )
    with pytest.raises(AssertionError, match="works on cpu"):
        work_elsewhere(tiny(), 1)


@needs_cuda
@pytest.mark.parametrize(("changes", "replicas"), CASES)
def test_cuda_graphs_train_as_eager_operations_do(tiny, changes, replicas):
    scenario = tiny(changes)
    eager, recorded = (
        Trainer(scenario, 3, "cuda", replicas, use_graphs=use) for use in (False, True)
    )
    for _ in range(4):
        logs = [iterated(trainer, 1) for trainer in (eager, recorded)]
        for first, second in zip(*logs, strict=True):
            # Of few samples, one more that is clipped makes a difference.
            assert second == pytest.approx(first, rel=1e-2, abs=1e-2)
    for i in range(replicas):
        assert_alike(recorded.weights(i), eager.weights(i), 1e-3)


@needs_cuda
def test_cuda_graphs_go_on_from_a_state(scenario):
    whole = Trainer(scenario, 3, "cuda")
    iterated(whole, 3)
    other = Trainer(scenario, 5, "cuda")
    iterated(other, 3)
    other.load_state_dict(whole.state_dict())
    for trainer in (whole, other):
        iterated(trainer, 3)
    assert_alike(other.weights(), whole.weights(), 1e-3)
