"""What commands import: neither Ctrl-C nor the collector of garbage comes in between."""

import gc
import signal

import pytest

from iout_marl.terminal import imports_uninterrupted


@pytest.fixture(autouse=True)
def _as_before():
    frozen = gc.get_freeze_count()
    yield
    gc.enable()
    if not frozen:
        gc.unfreeze()


def test_collector_waits_and_spares_what_was_imported():
    with imports_uninterrupted():
        assert not gc.isenabled()
        with imports_uninterrupted():
            pass
        assert not gc.isenabled()
        brought = [[]]
    assert gc.isenabled()
    assert not any(each is brought for each in gc.get_objects())  # nor looked through again


def test_collector_comes_back_after_a_failure():
    with pytest.raises(ImportError), imports_uninterrupted():
        raise ImportError
    assert gc.isenabled()


def test_collector_that_is_off_stays_off():
    gc.disable()
    with imports_uninterrupted():
        pass
    assert not gc.isenabled()


def test_interrupt_waits_for_imports():
    loaded = []

    def load():
        with imports_uninterrupted():
            signal.raise_signal(signal.SIGINT)
            loaded.append(True)

    with pytest.raises(KeyboardInterrupt):
        load()
    assert loaded
