"""Whatever becomes of the terminal: what was asked for in a file is there, and no traceback."""

import json
import os
import pty
import signal
import subprocess
import sys
import time

import forked
import pytest
from forked import CLOSED, PATIENCE_S, PIPE

from iout_marl import terminal

pytestmark = pytest.mark.slow

IOUT = [sys.executable, "-m", "iout_marl"]
EVALUATE = ["evaluate", "paper/k3-fdd", "--policy", "greedy", "--episodes", "2"]
FULL = pytest.param("2>/dev/full", marks=pytest.mark.linux, id="2>/dev/full")
ALL = [["scenarios"], ["show", "paper/k3-fdd"], ["--help"], ["--version"], EVALUATE]


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def shell(line, **environment):
    """Run a line of a shell in which $IOUT is the command; its last status and what it says.

    For what is about Python's own start or end; `iout` takes less time.
    """
    line = line.replace("$IOUT", " ".join(IOUT))
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", line],
        capture_output=True,
        check=False,
        env={**os.environ, **environment},
    )
    return done.returncode, done.stdout.decode(errors="replace"), done.stderr.decode()


def iout(words, out=PIPE, err=PIPE, **environment):
    """Run the command with its output and error led elsewhere; its status and what it says."""
    streams, env = (PIPE, out, err), {**os.environ, **environment}
    done = forked.run(*words, streams=streams, env=env)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def unread():
    """A pipe whose reader has gone."""
    read, write = os.pipe()
    os.close(read)
    yield write
    os.close(write)


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
@pytest.mark.parametrize(
    "words", [["scenarios"], ["show", "best/k3-tdd"], EVALUATE], ids=lambda words: words[0]
)
def test_any_encoding_will_do(words, encoding):
    status, out, err = iout(words, PYTHONIOENCODING=encoding)
    assert (status, err) == (0, "")
    assert out


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_json_is_the_same_in_any_encoding(tmp_path, encoding):
    (tmp_path / "Ünï–✓.yaml").write_text("extends: paper/k3-fdd\ndescription: β ± ✓")
    words = ["evaluate", "Ünï–✓.yaml", "--policy", "tour", "--json", "-"]
    status, out, _ = shell(f"$IOUT {' '.join(words)}", PYTHONIOENCODING=encoding)
    assert status == 0
    assert out.isascii()
    assert json.loads(out)["scenario"] == "Ünï–✓"
    assert out == iout(words)[1]


def test_a_message_in_an_encoding_that_lacks_its_characters():
    status, _, err = shell("$IOUT show Ünï✓", PYTHONIOENCODING="ascii")
    assert status == 2
    assert err.startswith("iout: no scenario '\\xdcn\\xef\\u2713'")


CLOSED_ONES = {
    ">&-": (PIPE, CLOSED, PIPE),
    "2>&-": (PIPE, PIPE, CLOSED),
    ">&- 2>&-": (PIPE, CLOSED, CLOSED),
    ">/dev/null": (PIPE, os.devnull, PIPE),
}


@pytest.mark.parametrize("streams", CLOSED_ONES.values(), ids=CLOSED_ONES)
def test_closed_streams_cost_no_result(tmp_path, streams):
    done = forked.run(*EVALUATE, "--json", "x.json", streams=streams)
    assert done.returncode == 0, (done.stdout, done.stderr)
    assert done.stderr == ""
    assert json.loads((tmp_path / "x.json").read_text())["episodes"] == 2


def test_streams_that_python_finds_closed_cost_no_result(tmp_path):
    status, out, err = shell(f"$IOUT {' '.join(EVALUATE)} --json x.json <&- >&- 2>&-")
    assert (status, out, err) == (0, "", "")
    assert (tmp_path / "x.json").read_text().endswith("}\n")


@pytest.mark.parametrize("words", ALL, ids=lambda words: words[0])
@pytest.mark.linux
def test_a_full_disk_is_said_in_one_line(words):
    status, _, err = iout(words, "/dev/full")
    assert status == 2
    assert err.endswith("put: No space left on device\n")
    assert err.count("\n") == 1


@pytest.mark.linux
def test_a_full_disk_costs_no_result(tmp_path):
    status, _, err = shell(f"$IOUT {' '.join(EVALUATE)} --json x.json > /dev/full")
    assert (status, err.count("\n")) == (2, 1)
    assert json.loads((tmp_path / "x.json").read_text())["episodes"] == 2


@pytest.mark.parametrize("words", [*ALL, [*EVALUATE, "--json", "-"]], ids=" ".join)
def test_a_reader_that_has_gone_is_no_error(words, unread):
    status, _, err = iout(words, unread)
    assert (status, err) == (141, "")


def test_a_reader_that_has_gone_is_no_error_as_python_ends_either():
    status, _, err = shell(f"$IOUT {' '.join(EVALUATE)} | true")
    assert (status, err) == (141, "")


@pytest.mark.parametrize("stream", ["2>&-", FULL, "2>&1 | true"])
def test_an_error_that_nobody_hears_is_one(stream):
    assert shell(f"$IOUT show nothing {stream}")[0] == 2


def test_no_file_is_taken_for_standard_output(tmp_path):
    forked.run(*EVALUATE, "--json", "x.json", streams=(CLOSED, CLOSED, PIPE))
    assert (tmp_path / "x.json").read_text().endswith("}\n")


def in_terminal(words, columns, **environment):
    """What the command writes to a terminal of so many columns."""
    import fcntl
    import struct
    import termios

    mine, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", 50, columns, 0, 0))
    keep = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "LINES", "NO_COLOR")}
    env = {**keep, "TERM": "xterm", **environment}
    process = forked.Iout(words, streams=(PIPE, its, its), env=env)
    os.close(its)
    written = b""
    while True:
        try:
            more = os.read(mine, 4096)
        except OSError:  # the terminal's end
            break
        if not more:
            break
        written += more
    os.close(mine)
    with process:
        return process.wait(PATIENCE_S), written.decode()


@pytest.mark.parametrize("columns", [20, 40, 200])
@pytest.mark.parametrize("words", [["scenarios"], EVALUATE], ids=lambda words: words[0])
def test_no_figure_or_name_is_cut_off_in_a_narrow_terminal(words, columns):
    status, out = in_terminal(words, columns)
    assert status == 0
    assert "…" not in out
    if words == EVALUATE:
        assert "harvested kJ" in out
    else:
        assert "multi/m4-k50-tdd" in out


def test_long_headings_are_folded_in_a_terminal(tmp_path):
    import trainers
    from iout_marl import load_scenario

    scenario = load_scenario("paper/k3-fdd", {"training.steps": 1, "episode.duration_s": 60})
    name = "a-run-of-a-name-that-is-far-longer-than-any-of-the-figures-below-it"
    trainers.train(scenario, tmp_path / name, evaluation_episodes=1)
    words = ["evaluate", f"{name}/scenario.yaml", *["--policy", name, "--policy", "greedy"] * 2]
    status, out = in_terminal(words, 80)
    assert status == 0
    assert max(len(line) for line in out.splitlines() if "│" in line) <= 80
    assert "…" not in out


def test_colours_and_bold_are_for_terminals():
    assert "\x1b[" in in_terminal(["scenarios"], 80)[1]
    assert "\x1b[3" not in in_terminal(["scenarios"], 80, NO_COLOR="1")[1]
    for words in ALL:
        assert "\x1b" not in iout(words, TERM="xterm-256color")[1]


def test_a_working_folder_that_is_gone():
    line = "mkdir gone && cd gone && rmdir ../gone && $IOUT evaluate paper/k3-fdd"
    environment = {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    status, out, err = shell(line, **environment)
    assert (status, out) == (2, "")
    assert err == "iout: the working folder is gone: change to one that is there\n"


@pytest.mark.parametrize("after", ["numpy", "pydantic", "typer", "iout_marl.outlook"])
def test_ctrl_c_during_imports(tmp_path, after):
    """Python's own start aside, there is no moment at which Ctrl-C shows a traceback."""
    (tmp_path / "site").mkdir()
    program = (
        "import builtins, os, signal\n"
        "before = builtins.__import__\n"
        "def watched(name, *rest, **more):\n"
        "    found = before(name, *rest, **more)\n"
        f"    if name == {after!r}:\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "    return found\n"
        "builtins.__import__ = watched\n"
    )
    (tmp_path / "site" / "sitecustomize.py").write_text(program)
    path = os.pathsep.join([str(tmp_path / "site"), *filter(None, sys.path)])
    status, out, err = shell("$IOUT scenarios", PYTHONPATH=path)
    assert (status, out, err) == (130, "", "iout: interrupted\n")


def test_ctrl_c_while_a_command_runs():
    words = ["evaluate", "best/k10-fdd", "--policy", "planner", "--planner-seconds", "60"]
    with subprocess.Popen(
        [*IOUT, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        time.sleep(2)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate()
    assert (out, err) == ("", "iout: interrupted\n")
    # Ended by the signal, or by the status that shells give for it.
    assert process.returncode in (130, -signal.SIGINT)


def test_a_program_that_imports_the_package_keeps_its_ctrl_c():
    program = (
        "import os, signal, iout_marl\n"
        "try: os.kill(os.getpid(), signal.SIGINT)\n"
        "except KeyboardInterrupt: print('caught')"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert done.stdout == b"caught\n"


@pytest.mark.parametrize("error", ["ImportError('no CUDA here')", "OSError('libx.so: not found')"])
def test_torch_that_cannot_be_imported(tmp_path, error):
    (tmp_path / "site" / "torch").mkdir(parents=True)
    (tmp_path / "site" / "torch" / "__init__.py").write_text(f"raise {error}")
    path = os.pathsep.join([str(tmp_path / "site"), *filter(None, sys.path)])
    status, out, err = shell("$IOUT train paper/k3-fdd --out run", PYTHONPATH=path)
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert error.split("'")[1] in err


def test_closing_what_is_left_of_the_output_never_raises(monkeypatch):
    class Broken:
        def flush(self):
            raise BrokenPipeError(32, "Broken pipe")

        def fileno(self):
            raise OSError

    monkeypatch.setattr(sys, "stdout", Broken())
    assert isinstance(terminal.finish_output(), BrokenPipeError)
