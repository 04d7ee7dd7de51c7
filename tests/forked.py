"""The command line in a process that has all it imports already: it starts in no time.

It is a process in every respect: files, locks, signals, exit status. Only how Python starts is not
tested so: where that matters, tests run `python -m iout_marl`.
"""

import importlib
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import reduction

PATIENCE_S = 120
PRELOADED = [
    *("forked", "iout_marl.cli", "iout_marl.study.run", "trainers.training"),
    *("torch.utils.tensorboard", "matplotlib.figure", "iout_marl.paper", "jinja2", "plotly"),
    *("distributed.cli.dask_scheduler", "distributed.cli.dask_worker", "torch.distributed.run"),
]
#: What a stream can be, besides a descriptor or the path of a file.
PIPE, CLOSED = "pipe", "closed"


def context():
    """Starts processes as `multiprocessing` does, with all imported that the tests need."""
    started = multiprocessing.get_context("forkserver")
    started.set_forkserver_preload(PRELOADED)
    return started


class _Stream:
    """A descriptor, open in the process to which it is sent."""

    def __init__(self, descriptor):
        self.descriptor = descriptor

    def __reduce__(self):
        return _received, (reduction.DupFd(self.descriptor),)


def _received(duplicate):
    return duplicate.detach()


def _open_streams(descriptors, encoding):
    """Let standard streams lead to descriptors, as Python does when it starts."""
    encoding = encoding or None
    modes = ("r", None), ("w", None), ("w", "backslashreplace")
    names = ("stdin", "stdout", "stderr")
    for number, (descriptor, (mode, errors)) in enumerate(zip(descriptors, modes, strict=True)):
        stream = None
        if descriptor == CLOSED:
            os.close(number)
        else:
            os.dup2(descriptor, number)
            os.close(descriptor)
            buffering = 1 if number == 2 else -1
            stream = os.fdopen(number, mode, buffering, encoding=encoding, errors=errors)
        setattr(sys, names[number], stream)
        setattr(sys, f"__{names[number]}__", stream)


def _be_iout(words, descriptors, folder, environment, before, leads, forks, program):
    if leads:
        os.setsid()
    if forks:
        from iout_marl.study.pools import LocalProcesses

        LocalProcesses.context = multiprocessing.get_context("fork")
    os.environ.clear()
    os.environ.update(environment)
    tempfile.tempdir = None  # what was found in another environment
    _open_streams(descriptors, environment.get("PYTHONIOENCODING"))
    os.chdir(folder)
    # The forkserver may have been started by a study, which lets signals wait meanwhile.
    signal.pthread_sigmask(signal.SIG_SETMASK, [])
    for name, usual in (("SIGINT", signal.default_int_handler), ("SIGTERM", signal.SIG_DFL)):
        signal.signal(getattr(signal, name), usual)
    sys.argv = ["iout", *words]
    sys.orig_argv = [sys.executable, "-m", "iout_marl", *words]
    import torch

    torch.set_num_threads(1)
    exec(before, {})
    importlib.import_module(program).main()


class Iout:
    """Starts `iout`, with what of `subprocess.Popen` the tests need; pipes are of text.

    Args:
        words: of the command line.
        before: a program that the process runs first.
        streams: where standard input, output and error lead: `PIPE`, `CLOSED`, a descriptor or the
            path of a file that is written.
        env: its environment. What Python heeds of it as it starts has no effect, but for the
            encoding of streams.
        folder: in which it works.
        leads: whether it leads a session of its own.
        forks: whether workers of studies are copies of it, which need not import anything. None of
            its libraries has threads then that could be lost.
        program: the module whose `main` it runs, of another command than `iout`.
    """

    def __init__(
        self,
        words,
        before="",
        *,
        streams=(PIPE, PIPE, PIPE),
        env=None,
        folder=None,
        leads=False,
        forks=False,
        program="iout_marl.cli",
    ):
        env = dict(os.environ if env is None else env)
        encoding = env.get("PYTHONIOENCODING") or None
        ours, its, opened = [None] * 3, list(streams), []
        for number, stream in enumerate(streams):
            if stream == PIPE:
                read, write = os.pipe()
                its[number], mine = (read, write) if number == 0 else (write, read)
                ours[number] = os.fdopen(mine, "w" if number == 0 else "r", encoding=encoding)
                opened.append(its[number])
            elif stream != CLOSED and isinstance(stream, str):
                its[number] = os.open(stream, os.O_WRONLY)
                opened.append(its[number])
        self.stdin, self.stdout, self.stderr = ours
        self._process = context().Process(
            target=_be_iout,
            args=(
                list(map(str, words)),
                [CLOSED if stream == CLOSED else _Stream(stream) for stream in its],
                str(folder or os.getcwd()),  # noqa: PTH109
                env,
                before,
                leads,
                forks,
                program,
            ),
        )
        self._process.start()
        for descriptor in opened:
            os.close(descriptor)

    @property
    def pid(self):
        return self._process.pid

    @property
    def returncode(self):
        return self._process.exitcode

    def poll(self):
        return self._process.exitcode

    def wait(self, timeout=None):
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired("iout", timeout)
        return self._process.exitcode

    def send_signal(self, number):
        os.kill(self._process.pid, number)

    def kill(self):
        self._process.kill()

    def communicate(self, timeout=None):
        """Close its input; what it wrote to output and error, where those are pipes."""
        if self.stdin is not None:
            self.stdin.close()
        streams = [stream for stream in (self.stdout, self.stderr) if stream is not None]
        with ThreadPoolExecutor(2) as readers:
            texts = {stream: readers.submit(stream.read) for stream in streams}
            try:
                self.wait(timeout)
            except subprocess.TimeoutExpired:
                self.kill()
                raise
            found = {stream: text.result() for stream, text in texts.items()}
        for stream in streams:
            stream.close()
        return tuple(found.get(stream, "") for stream in (self.stdout, self.stderr))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Close our ends of pipes, and see it to its end."""
        for stream in filter(None, (self.stdin, self.stdout, self.stderr)):
            stream.close()
        try:
            self.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.kill()
            raise


def run(*words, before="", **options):
    """Run `iout` to its end, like `subprocess.run`; options are those of `Iout`.

    Where processes cannot be forked, Python starts anew.
    """
    if os.name == "nt" and not before and not options:
        command = [sys.executable, "-m", "iout_marl", *map(str, words)]
        return subprocess.run(command, capture_output=True, text=True, check=False)
    with Iout(words, before, **options) as process:
        out, err = process.communicate(PATIENCE_S)
    return subprocess.CompletedProcess(list(words), process.returncode, out, err)
