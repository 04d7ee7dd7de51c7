"""Other people's environments, and this world on JAX."""

from __future__ import annotations

import importlib.util
import os
import statistics
import time
import warnings
from collections.abc import Callable, Iterator
from typing import Any

from cases import Case, Given, LeftOut, Row

from on_gpu.measuring import REPEATS, SLOTS, forget, memory, powers, rate, seconds, while_it_fits
from on_gpu.world import reset_world


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
