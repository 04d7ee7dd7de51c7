"""What there is to learn from half an hour on one NVIDIA GPU, in one JSON.

Does it work: the tests that need such a device, training by captured graphs beside eager
training to the last bit, an NCCL group. How fast is it: the world, training, the time to a
policy of a certain quality, other people's environments. And why: a profile of an iteration.

Each case runs in a process of its own with a limit of time, so that a crash, a hang or a lack
of memory costs that case alone. The JSON is written anew after every case. Without a CUDA
device every step says so; `--device cpu` runs what a CPU can do, graphs by their emulation
in `tests/emulated_graph.py`.

    python benchmarks/gpu.py [--steps tests equal …] [--minutes 30] [--quick] [--out gpu.json]
    python benchmarks/gpu.py --device cpu --steps world training --minutes 60
"""

from __future__ import annotations

import gc
import importlib.util
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cases
import numpy as np
import time_to_quality
import torch
from cases import ROOT, Case, Given, LeftOut, Row, Step
from torch import Tensor, distributed

from iout_marl.errors import InputError, is_lack_of_memory
from iout_marl.scenario import load_scenario
from iout_marl.world import State, World, node_codes
from trainers import Trainer
from trainers.accel import graphs
from trainers.accel.graphs import CapturedFunction, Graph, write_over
from trainers.accel.group import ProcessGroup
from trainers.accel.processes import DistributedGroup
from trainers.collector import Collector

SCENARIO = "paper/k10-fdd"
SLOTS = 100
REPEATS = 3
#: The first call is eager, the second captures, the third replays.
WARM = 3
SET_NETWORK = {"observation.kind": "table", "training.network": "set"}


def about(given: Given) -> Iterator[Row]:
    """The device."""
    if given.device == "cpu":
        yield {"name": "cpu", "torch": torch.__version__}
        return
    if not torch.cuda.is_available():
        yield {}
        return
    device = torch.cuda.get_device_properties(0)
    yield {
        "name": device.name,
        "driver": driver(),
        "CUDA": torch.version.cuda,
        "torch": torch.__version__,
        "capability": f"{device.major}.{device.minor}",
        "multiprocessors": device.multi_processor_count,
        "memory_mb": device.total_memory // 2**20,
    }


def driver() -> str | None:
    """Version of the driver, as its own tool tells it."""
    command = ["nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, check=True, timeout=20)
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip().partition("\n")[0]


def synchronise(device: str) -> None:
    """Wait for a device."""
    if device == "cuda":
        torch.cuda.synchronize()


def seconds(work: Callable[[], object], device: str, repeats: int = REPEATS) -> list[float]:
    """How long work takes, again and again."""
    found = []
    for _ in range(repeats):
        synchronise(device)
        started = time.perf_counter()
        work()
        synchronise(device)
        found.append(time.perf_counter() - started)
    return found


def rate(steps: int, took_s: list[float]) -> Row:
    """Steps a second."""
    rates = [steps / s for s in took_s]
    return {"steps/s": statistics.median(rates), "min": min(rates), "max": max(rates)}


def memory(device: str) -> Row:
    """Most memory that was held since the last `forget`."""
    return {"MB": torch.cuda.max_memory_reserved() / 1e6} if device == "cuda" else {}


def forget(device: str) -> None:
    """Give back the memory of what was measured before."""
    gc.collect()
    if device == "cuda":
        torch.cuda.init()
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats()


def while_it_fits(sizes: list[int], name: str, measure: Callable[[int], Row]) -> Iterator[Row]:
    """A row for each size, until one does not fit into memory."""
    for size in sizes:
        try:
            yield {name: size, **measure(size)}
        except (InputError, RuntimeError, MemoryError) as error:
            is_full = isinstance(error, torch.OutOfMemoryError) or is_lack_of_memory(error)
            if not is_full and "not enough memory" not in str(error):
                raise
            raise LeftOut(f"{size:,} {name} do not fit into memory") from None


def powers(first: int, last: int) -> list[int]:
    """Powers of four, from one to another."""
    return [4**i for i in range(13) if first <= 4**i <= last]


# Tests


def run_tests(*arguments: str) -> Case:
    """Tests, each failure with its reason."""

    def measure(_: Given) -> Iterator[Row]:
        options = ["-vv", "-rfE", "--tb=short", "-p", "no:cacheprovider"]
        command = [sys.executable, "-m", "pytest", *options, "-o", "faulthandler_timeout=60"]
        counts = dict.fromkeys(("PASSED", "FAILED", "ERROR", "SKIPPED"), 0)
        reasons: dict[str, str] = {}
        with subprocess.Popen(
            [*command, *arguments], cwd=ROOT, stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            for line in process.stdout:
                print(line, end="")
                if found := re.match(r"(tests/\S*::.*?) (PASSED|FAILED|ERROR|SKIPPED)\b", line):
                    counts[found[2]] += 1
                elif found := re.match(r"(?:FAILED|ERROR) (tests/\S*::.*?) - (.*)", line):
                    reasons[found[1]] = found[2]
        yield {name.lower(): count for name, count in counts.items()}
        for test, why in reasons.items():
            yield {"test": test, "why": why}
        if process.returncode not in (0, 1, 5):  # passed, failed, none collected
            raise RuntimeError(f"pytest has ended with exit status {process.returncode}")

    return measure


def tests_of_gpus() -> list[str]:
    """Files with tests that are marked so."""
    found = [
        path.relative_to(ROOT).as_posix()
        for path in sorted((ROOT / "tests").rglob("test_*.py"))
        if re.search(r"needs_cuda|mark\.gpu", path.read_text(encoding="utf-8"))
    ]
    assert found
    return found


OF_GRAPHS = ["tests/trainers/test_graphs.py", "tests/trainers/test_accelerator.py"]


# Captured training beside eager training


#: Scenario, changes, policies side by side.
SETTINGS: dict[str, tuple[str, dict[str, Any], int]] = {
    "paper/k10-fdd": ("paper/k10-fdd", {}, 1),
    "best/k10-tdd": ("best/k10-tdd", {"training.mask_actions": True}, 1),
    "multi/m3-k10-fdd": ("multi/m3-k10-fdd", {}, 1),
    "4 policies": ("paper/k10-fdd", {}, 4),
    "running scaling": (
        "best/k10-fdd",
        {"training.observation_scaling": "running", "training.reward_scaling": "running"},
        1,
    ),
    "central critic": ("multi/m2-k10-fdd", {"training.critic": "central"}, 1),
    "set network": ("best/k10-fdd", SET_NETWORK, 1),
    "sea/bay-tide": ("sea/bay-tide", {"training.rollout_slots": 100}, 1),
}


def emulate_graphs() -> None:
    """Let a CPU do what a CUDA device does: the world on torch, and graphs."""
    from trainers import collector

    sys.path.insert(0, str(ROOT / "tests"))
    from emulated_graph import EmulatedGraph

    collector.NUMPY_DEVICES = ()
    graphs.GRAPHS["cpu"] = EmulatedGraph


def keep_rollouts() -> None:
    """Let a collector know the last rollout that it has collected."""
    collect = Collector.collect

    def kept(self: Collector, *args: Any, **kwargs: Any) -> Any:
        self.last_rollout = collect(self, *args, **kwargs)  # type: ignore[attr-defined]
        return self.last_rollout  # type: ignore[attr-defined]

    Collector.collect = kept  # type: ignore[method-assign]


def iterated(trainer: Trainer) -> dict[str, Tensor]:
    """All numbers of one more iteration, in the order in which they come about."""
    logs = trainer.iterate_all()
    rollout = trainer.collector.last_rollout  # type: ignore[attr-defined]
    found = {
        f"rollout.{name}": tensor.detach().clone()
        for name, tensor in vars(rollout).items()
        if isinstance(tensor, Tensor)
    }
    for tag in logs[0]:
        if not tag.startswith("speed/"):
            numbers = [log[tag] for log in logs]
            found[tag] = torch.tensor(numbers, dtype=torch.float64)
    for name, tensor in trainer.network.state_dict().items():
        found[f"weights.{name}"] = tensor.clone()
    return found


def difference(one: Tensor, other: Tensor) -> str | None:
    """By how much tensors differ, if they do; numbers that are none are equal."""
    differs = (one != other) & ~((one != one) & (other != other))
    count = int(differs.sum())
    if not count:
        return None
    apart = (one.double() - other.double()).abs()
    return (
        f"{count:,} of {one.numel():,} numbers, by {float(apart.max()):.3g} at most, "
        f"of {float(one.double().abs().max()):.3g}"
    )


def equal(setting: str, *, deterministic: bool = False) -> Case:
    """Captured training beside eager training, and eager training beside itself."""

    def compare(given: Given) -> Iterator[Row]:
        if given.device == "cpu":
            emulate_graphs()
        if deterministic:
            # Before the first product; without it cuBLAS may add up otherwise on another stream.
            os.environ["CUBLAS_WORKSPACE_CONFIG"] = ":4096:8"
            torch.use_deterministic_algorithms(mode=True, warn_only=True)
        keep_rollouts()
        name, changes, replicas = SETTINGS[setting]
        small = {"training.environments": 16, "training.rollout_slots": 10}
        scenario = load_scenario(name, {**changes, **(small if given.quick else {})})
        make = partial(Trainer, scenario, 3, given.device, replicas)
        trainers = {
            "eager": make(use_graphs=False),
            "eager again": make(use_graphs=False),
            "captured": make(),
        }
        iterations = 4 if given.quick else 6
        differs: dict[str, str] = {}
        ms: dict[str, float] = {}
        last: dict[str, dict[str, Tensor]] = {}
        for number in range(1, iterations + 1):
            for subject, trainer in trainers.items():
                synchronise(given.device)
                started = time.perf_counter()
                last[subject] = iterated(trainer)
                synchronise(given.device)
                ms[subject] = 1e3 * (time.perf_counter() - started)
                for tensor, expected in last["eager"].items():
                    by = difference(expected, last[subject][tensor])
                    if by and subject not in differs:
                        differs[subject] = f"no: in iteration {number} {tensor} first, {by}"
        for subject in ("captured", "eager again"):
            weights = [
                float((tensor.double() - last[subject][name].double()).abs().max())
                for name, tensor in last["eager"].items()
                if name.startswith("weights.")
            ]
            yield {
                "ms, eager": ms["eager"],
                "ms": ms[subject],
                "weights by": max(weights),
                "beside eager": subject,
                "equal": differs.get(subject, f"yes, for {iterations} iterations"),
            }

    return compare


# The world


def in_place(
    slot: Callable[[State, Any], tuple[State, Any, Any]], state: State, graph: Graph
) -> Callable[[State, Any], tuple[State, Any, Any]]:
    """The slot, captured, on a state that stays where it is, whatever state comes in."""

    def play(action: Tensor) -> tuple[Tensor, Tensor]:
        after, reward, observation = slot(state, action)
        write_over(state, after)
        return reward, observation

    captured = CapturedFunction(play, lambda _: graph, state.age.device)
    return lambda _, action: (state, *captured(action))


def reset_world(library: Any, envs: int, device: str | None) -> tuple[World, State, list[Any]]:
    """A world, its first state, and actions of some slots."""
    world = World(load_scenario(SCENARIO), envs, library=library, dtype="float32", device=device)
    state = world.reset(node_codes(world.scenario, world.grid, [np.random.default_rng(0)] * envs))
    rng, sizes = np.random.default_rng(0), world.action_sizes
    actions = [
        world.backend.integers((rng.random((envs, world.num_auvs, len(sizes))) * sizes).astype(int))
        for _ in range(8)
    ]
    return world, state, actions


def world_alone(library: Any, *, captured: bool = False, compiled: bool = False) -> Case:
    """Slots with reward and observation."""

    def measure_size(device: str, envs: int) -> Row:
        torch.compiler.reset()
        forget(device)
        world, state, actions = reset_world(library, envs, None if library is np else device)
        slot = torch.compile(world.slot, fullgraph=True, dynamic=False) if compiled else world.slot
        if captured:
            # A graph reads and writes the same memory each time, every field its own.
            state = state.map(torch.clone)
            slot = in_place(slot, state, graphs.GRAPHS[device](torch.device(device)))

        def play(slots: int) -> None:
            nonlocal state
            for t in range(slots):
                state, _, _ = slot(state, actions[t % len(actions)])

        started = time.perf_counter()
        play(WARM)
        synchronise(device)
        ready_s = time.perf_counter() - started
        found = rate(SLOTS * envs, seconds(partial(play, SLOTS), device))
        return {**found, "ready after s": ready_s, **memory(device)}

    def measure(given: Given) -> Iterator[Row]:
        device = "cpu" if library is np else given.device
        if captured and device == "cpu":
            raise LeftOut("a CPU has no graphs")
        sizes = powers(4, 65_536) if device == "cpu" else powers(256, 4_194_304)
        if compiled:  # which takes a while for each
            sizes = sizes[2::2]
        sizes = [16, 256] if given.quick else sizes
        return while_it_fits(sizes, "environments", partial(measure_size, device))

    return measure


# Training


def training(
    name: str,
    sizes_on_cpu: list[int],
    sizes: list[int],
    changes: dict[str, Any],
    *,
    use_graphs: bool = True,
    on_cpu: bool = False,
    precision: str = "highest",
) -> Case:
    """Iterations of training, by environments or by policies side by side."""

    def measure_size(device: str, size: int) -> Row:
        forget(device)
        replicas = size if name == "policies" else 1
        envs = 16 if name == "policies" else size
        scenario = load_scenario(SCENARIO, {"training.environments": envs, **changes})
        started = time.perf_counter()
        trainer = Trainer(scenario, device=device, replicas=replicas, use_graphs=use_graphs)
        for _ in range(WARM):
            trainer.iterate_all()
        synchronise(device)
        ready_s = time.perf_counter() - started
        found = rate(replicas * trainer.steps_per_iteration, seconds(trainer.iterate_all, device))
        return {**found, "ready after s": ready_s, **memory(device)}

    def measure(given: Given) -> Iterator[Row]:
        if on_cpu and given.device == "cpu":
            raise LeftOut("it is what was measured above")
        device = "cpu" if on_cpu else given.device
        if device == "cpu" and not use_graphs:
            raise LeftOut("a CPU has no graphs")
        if device == "cpu" and precision != "highest":
            raise LeftOut("a CPU has no TF32")
        torch.set_float32_matmul_precision(precision)
        wanted = sizes_on_cpu if device == "cpu" else sizes
        wanted = [1, 4] if given.quick and name == "policies" else [16] if given.quick else wanted
        return while_it_fits(wanted, name, partial(measure_size, device))

    return measure


# Quality


def to_quality(*, on_cpu: bool = False) -> Case:
    """Seconds from the start of a process to a policy of a certain quality."""

    def measure(given: Given) -> Iterator[Row]:
        if on_cpu and given.device == "cpu":
            raise LeftOut("it is what was measured above")
        device = "cpu" if on_cpu else given.device
        for seed in range(1 if given.quick else 3):
            limit_s = 20.0 if given.quick else 120.0
            outcome = time_to_quality.race(
                time_to_quality.OURS, "best/k10-fdd", seed, limit_s, device
            )
            yield {
                "seed": seed,
                "s": outcome.seconds,
                "steps": outcome.env_steps,
                "mean AoI": outcome.mean_aoi,
            }

    return measure


def many_policies(given: Given) -> Iterator[Row]:
    """A whole training of many policies side by side, at the default preset."""
    policies = 4 if given.quick else 256
    changes = {"training.steps": 204_800} if given.quick else {}
    trainer = Trainer(load_scenario(SCENARIO, changes), device=given.device, replicas=policies)
    iterations = trainer.settings.steps // trainer.steps_per_iteration
    for number in range(1, iterations + 1):
        logs = trainer.iterate_all()
        if number * 4 % iterations < 4:
            ages = [log["aoi/mean"] for log in logs]
            yield {
                "policies": policies,
                "iterations": number,
                "s": time.perf_counter() - cases.STARTED,
                "mean AoI": statistics.mean(ages),
                "min": min(ages),
                "max": max(ages),
                **memory(given.device),
            }


# A group of one process


def group(*, use_graphs: bool) -> Case:
    """Exchanges of a group of one, and training by it beside training without."""

    def measure(given: Given) -> Iterator[Row]:
        if use_graphs and given.device == "cpu":
            raise LeftOut("a CPU has no graphs")
        device = torch.device(given.device)
        backend = "nccl" if given.device == "cuda" else "gloo"
        with tempfile.TemporaryDirectory() as folder:
            distributed.init_process_group(
                backend, init_method=f"file://{folder}/store", world_size=1, rank=0
            )
            alone = DistributedGroup(device)
            yield from exchanges(alone, given.device) if not use_graphs else ()
            yield by_group(alone, given, use_graphs=use_graphs)
            distributed.destroy_process_group()

    return measure


def exchanges(alone: ProcessGroup, device: str) -> Iterator[Row]:
    """What a group of one does to numbers, and how long it takes."""
    numbers = torch.arange(250_000, dtype=torch.float32, device=device)
    asked: dict[str, Callable[[], bool]] = {
        "sum": lambda: torch.equal(alone.sum(numbers.clone()), numbers),
        "join": lambda: torch.equal(alone.join(numbers), numbers),
        "any": lambda: alone.any(flag=True) and not alone.any(flag=False),
        "largest": lambda: alone.largest(7) == 7,
    }
    for name, is_right in asked.items():
        right = is_right()
        ms = [1e3 * s for s in seconds(is_right, device, 20)]
        yield {"ms": statistics.median(ms), "what": name, "found": "right" if right else "wrong"}


def by_group(alone: ProcessGroup, given: Given, *, use_graphs: bool) -> Row:
    """Training by a group beside training without one."""
    keep_rollouts()
    small = {"training.environments": 16} if given.quick else {}
    make = partial(Trainer, load_scenario(SCENARIO, small), 3, given.device, use_graphs=use_graphs)
    one, other = make(), make(group=alone)
    found = None
    for number in range(1, WARM + 2):
        expected, got = iterated(one), iterated(other)
        for name, tensor in expected.items():
            if found is None and (by := difference(tensor, got[name])):
                found = f"no: in iteration {number} {name} first, {by}"
    ms = 1e3 * seconds(other.iterate_all, given.device, 1)[0]
    return {"ms": ms, "what": "training", "found": found or "equal to training without a group"}


# A profile


#: Categories of a trace that the device works on.
ON_DEVICE = ("kernel", "gpu_memcpy", "gpu_memset")
OF_DRIVER = ("cuda_runtime", "cuda_driver")


def profile(changes: dict[str, Any], *, use_graphs: bool) -> Case:
    """An iteration, as the profiler sees it."""

    def measure(given: Given) -> Iterator[Row]:
        if given.device == "cpu":
            raise LeftOut("a CPU has no kernels; learning_step.py profiles its operations")
        scenario = load_scenario(SCENARIO, changes)
        trainer = Trainer(scenario, device=given.device, use_graphs=use_graphs)
        for _ in range(WARM):
            trainer.iterate_all()
        ms = [1e3 * s for s in seconds(trainer.iterate_all, given.device, 5)]
        yield {"figure": "iteration without the profiler, ms", "value": statistics.median(ms)}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "trace.json"
            for _ in range(2):  # the first starts the profiler
                with torch.profiler.profile() as profiler:
                    trainer.iterate_all()
                    torch.cuda.synchronize()
            profiler.export_chrome_trace(str(path))
            events = json.loads(path.read_text(encoding="utf-8"))["traceEvents"]
        yield from figures_of(events)

    return measure


def figures_of(events: Iterable[Row], most: int = 20) -> Iterator[Row]:
    """What the events of a trace come to: times there are in µs.

    Args:
        events: of the `traceEvents` of a trace.
        most: how many kernels to name.
    """
    whole = [e for e in events if e.get("ph") == "X" and "cat" in e]
    work = sorted((e for e in whole if e["cat"] in ON_DEVICE), key=lambda e: e["ts"])
    calls = [e for e in whole if e["cat"] in OF_DRIVER]
    if not work:
        raise LeftOut("the profiler has seen no kernel")
    gaps, end = [], work[0]["ts"]
    for event in work:
        gaps.append(max(event["ts"] - end, 0))
        end = max(end, event["ts"] + event["dur"])
    span = end - work[0]["ts"]
    waits = [e for e in calls if "Synchronize" in e["name"]]
    figures: dict[str, float] = {
        "kernels, copies and fills": len(work),
        "time of all of them, ms": sum(e["dur"] for e in work) / 1e3,
        "from the first to the end of the last, ms": span / 1e3,
        "gaps in between, ms": sum(gaps) / 1e3,
        "gaps of more than 10 µs": sum(gap > 10 for gap in gaps),
        "longest gap, µs": max(gaps),
        "launches of kernels": sum("LaunchKernel" in e["name"] for e in calls),
        "launches of graphs": sum("GraphLaunch" in e["name"] for e in calls),
        "waits of the host (one is the profile's)": len(waits),
        "waits of the host, ms": sum(e["dur"] for e in waits) / 1e3,
        "copies to the host": sum("DtoH" in e["name"] for e in work),
        "copies to the device": sum("HtoD" in e["name"] for e in work),
    }
    yield from ({"figure": name, "value": value} for name, value in figures.items())
    times: dict[str, list[float]] = defaultdict(list)
    for event in work:
        times[event["name"]].append(event["dur"])
    total = sum(sum(each) for each in times.values())
    for name, each in sorted(times.items(), key=lambda item: -sum(item[1]))[:most]:
        yield {
            "ms": sum(each) / 1e3,
            "share": sum(each) / total,
            "calls": len(each),
            "kernel": name,
        }


# Others


def need(*packages: str) -> None:
    """Leave a case out without packages."""
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        raise LeftOut(f"{', '.join(missing)} not installed")


def sizes_of_others(given: Given) -> list[int]:
    if given.quick:
        return [16]
    return powers(256, 16_384) if given.device == "cpu" else powers(4096, 1_048_576)


def vmas_spread(agents: int) -> Case:
    """VMAS's simple spread."""

    def measure(given: Given) -> Iterator[Row]:
        need("vmas")
        from environment import vmas_batch

        warnings.simplefilter("ignore")

        def measure_size(envs: int) -> Row:
            forget(given.device)
            subject = vmas_batch(agents, envs, device=given.device)
            rates = [subject("") for _ in range(REPEATS)]
            found = {"steps/s": statistics.median(rates), "min": min(rates), "max": max(rates)}
            return {**found, **memory(given.device)}

        return while_it_fits(sizes_of_others(given), "environments", measure_size)

    return measure


def jax_for(given: Given) -> Any:
    """JAX on the device."""
    need("jax")
    if given.device == "cpu":
        os.environ["JAX_PLATFORMS"] = "cpu"
    import jax

    if given.device == "cuda" and jax.default_backend() == "cpu":
        raise LeftOut("jax sees no GPU")
    # Whole numbers have 32 bits there, of which it warns.
    warnings.simplefilter("ignore")
    return jax


def world_on_jax(*, at_once: bool) -> Case:
    """This world on JAX: slot by slot, or many slots as one program."""

    def measure(given: Given) -> Iterator[Row]:
        jax = jax_for(given)

        def measure_size(envs: int) -> Row:
            world, state, actions = reset_world(jax.numpy, envs, None)
            slot = jax.jit(world.slot)
            stacked = jax.numpy.stack(actions)

            # Reward and observation are carried on: what nobody asks for is not computed.
            def play_on(carried: Any, t: Any) -> tuple[Any, None]:
                return world.slot(carried[0], stacked[t % len(stacked)]), None

            @jax.jit
            def play_all(carried: Any) -> Any:
                return jax.lax.scan(play_on, carried, jax.numpy.arange(SLOTS))[0]

            def play() -> None:
                nonlocal carried
                if at_once:
                    carried = play_all(carried)
                else:
                    for t in range(SLOTS):
                        carried = slot(carried[0], actions[t % len(actions)])
                jax.block_until_ready(carried)

            started = time.perf_counter()
            carried = slot(state, actions[0])
            play()
            ready_s = time.perf_counter() - started
            found = rate(SLOTS * envs, seconds(play, "cpu"))
            return {**found, "ready after s": ready_s}

        return while_it_fits(sizes_of_others(given), "environments", measure_size)

    return measure


def many_at_once(jax: Any, envs: int, reset: Callable[[], Any], step: Callable[..., Any]) -> Row:
    """Many steps of an environment on JAX as one program.

    Args:
        jax: the library.
        envs: environments side by side.
        reset: gives what is carried from step to step: observations, states and rewards.
        step: gives it after another step, by what was carried and a key.
    """

    @jax.jit
    def play_all(carried: Any, key: Any) -> Any:
        keys = jax.random.split(key, SLOTS)
        return jax.lax.scan(lambda *given: (step(*given), None), carried, keys)[0]

    def play() -> None:
        jax.block_until_ready(play_all(first, jax.random.key(1)))

    started = time.perf_counter()
    first = reset()
    play()
    ready_s = time.perf_counter() - started
    return {**rate(SLOTS * envs, seconds(play, "cpu")), "ready after s": ready_s}


def gymnax_cartpole(given: Given) -> Iterator[Row]:
    """CartPole of Gymnax, many steps as one program."""
    jax = jax_for(given)
    need("gymnax")
    import gymnax

    env, params = gymnax.make("CartPole-v1")

    def measure_size(envs: int) -> Row:
        step_all = jax.vmap(env.step, in_axes=(0, 0, 0, None))

        def reset() -> Any:
            keys = jax.random.split(jax.random.key(0), envs)
            return (*jax.vmap(env.reset, in_axes=(0, None))(keys, params), jax.numpy.zeros(envs))

        def step(carried: Any, key: Any) -> Any:
            keys = jax.random.split(key, envs)
            action = jax.random.randint(key, (envs,), 0, 2)
            return step_all(keys, carried[1], action, params)[:3]

        return many_at_once(jax, envs, reset, step)

    return while_it_fits(sizes_of_others(given), "environments", measure_size)


def jaxmarl_spread(agents: int) -> Case:
    """JaxMARL's simple spread, many steps as one program."""

    def measure(given: Given) -> Iterator[Row]:
        jax = jax_for(given)
        need("jaxmarl")
        import jaxmarl

        env = jaxmarl.make(
            "MPE_simple_spread_v3", num_agents=agents, num_landmarks=agents, action_type="Discrete"
        )

        def measure_size(envs: int) -> Row:
            def reset() -> Any:
                keys = jax.random.split(jax.random.key(0), envs)
                zeros = {agent: jax.numpy.zeros(envs) for agent in env.agents}
                return (*jax.vmap(env.reset)(keys), zeros)

            def step(carried: Any, key: Any) -> Any:
                keys = jax.random.split(key, (1 + len(env.agents), envs))
                actions = {
                    agent: jax.vmap(env.action_space(agent).sample)(own)
                    for agent, own in zip(env.agents, keys[1:], strict=True)
                }
                return jax.vmap(env.step)(keys[0], carried[1], actions)[:3]

            return many_at_once(jax, envs, reset, step)

        return while_it_fits(sizes_of_others(given), "environments", measure_size)

    return measure


STEPS = {
    "tests": Step(
        "do the tests pass that need a CUDA device, and those of what runs there?",
        300.0,
        {
            "marked gpu": run_tests("-m", "gpu", *tests_of_gpus()),
            "the others of graphs": run_tests("-m", "not gpu", *OF_GRAPHS),
        },
    ),
    "equal": Step(
        "is captured training eager training, bit for bit?",
        120.0,
        {
            **{name: equal(name) for name in SETTINGS},
            "deterministic algorithms": equal("paper/k10-fdd", deterministic=True),
        },
    ),
    "world": Step(
        f"environment steps a second, {SCENARIO}, with reward and observation",
        240.0,
        {
            "captured": world_alone(torch, captured=True),
            "eager": world_alone(torch),
            "compiled, captured": world_alone(torch, captured=True, compiled=True),
            "compiled": world_alone(torch, compiled=True),
            "NumPy": world_alone(np),
        },
    ),
    "training": Step(
        f"training steps a second, {SCENARIO}, policies with 16 environments each",
        180.0,
        {
            "MLP": training("environments", powers(4, 4096), powers(256, 65_536), {}),
            "policies": training("policies", powers(1, 64), powers(1, 4096), {}),
            "set network": training(
                "environments", powers(16, 256), powers(256, 16_384), SET_NETWORK
            ),
            "MLP, eager": training("environments", [], powers(256, 4096), {}, use_graphs=False),
            "MLP, TF32": training("environments", [], powers(4096, 65_536), {}, precision="high"),
            "MLP, cpu": training("environments", powers(256, 4096), [], {}, on_cpu=True),
        },
    ),
    "quality": Step(
        "seconds from the start: to a mean AoI of 6.0 in best/k10-fdd; of many policies",
        300.0,
        {
            "this trainer": to_quality(),
            f"many policies, {SCENARIO}": many_policies,
            "this trainer, cpu": to_quality(on_cpu=True),
        },
    ),
    "nccl": Step(
        "does a group of one process do what no group does?",
        90.0,
        {"eager": group(use_graphs=False), "captured": group(use_graphs=True)},
    ),
    "profile": Step(
        f"what does an iteration consist of, {SCENARIO}?",
        120.0,
        {
            "captured": profile({}, use_graphs=True),
            "eager": profile({}, use_graphs=False),
            "set network, captured": profile(SET_NETWORK, use_graphs=True),
        },
    ),
    "others": Step(
        "environment steps a second of others, and of this world on JAX",
        180.0,
        {
            "this world on JAX, at once": world_on_jax(at_once=True),
            "this world on JAX, by slots": world_on_jax(at_once=False),
            "VMAS spread, 1 agent": vmas_spread(1),
            "VMAS spread, 3 agents": vmas_spread(3),
            "JaxMARL spread, 3 agents": jaxmarl_spread(3),
            "Gymnax CartPole": gymnax_cartpole,
        },
    ),
}


if __name__ == "__main__":
    torch.set_num_threads(1)
    assert __doc__ is not None
    cases.main(__doc__.splitlines()[0], STEPS, about)
