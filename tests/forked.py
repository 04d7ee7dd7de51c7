"""The command line in a process that has all it imports already: it starts in no time.

It is a process in every respect: files, locks, signals, exit status. Only how Python starts is not
tested so: where that matters, tests run `python -m iout_marl`.
"""

import multiprocessing
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import reduction

PATIENCE_S = 120
PRELOADED = ["forked", "iout_marl.cli", "trainers.training", "torch.utils.tensorboard"]


class _Stream:
    """A descriptor, open in the process to which it is sent."""

    def __init__(self, descriptor):
        self.descriptor = descriptor

    def __reduce__(self):
        return _received, (reduction.DupFd(self.descriptor),)


def _received(duplicate):
    return duplicate.detach()


def _be_iout(words, streams, folder, environment, before):
    for number, descriptor in enumerate(streams):
        os.dup2(descriptor, number)
        os.close(descriptor)
    sys.stdin, sys.stdout = os.fdopen(0), os.fdopen(1, "w")
    sys.stderr = os.fdopen(2, "w", buffering=1)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for name, usual in (("SIGINT", signal.default_int_handler), ("SIGTERM", signal.SIG_DFL)):
        signal.signal(getattr(signal, name), usual)
    sys.argv = ["iout", *words]
    sys.orig_argv = [sys.executable, "-m", "iout_marl", *words]
    import torch

    from iout_marl.cli import main

    torch.set_num_threads(1)
    exec(before, {})
    main()


class Iout:
    """Starts `iout`, with what of `subprocess.Popen` the tests need; streams are pipes of text.

    Args:
        words: of the command line.
        before: a program that the process runs first.
    """

    def __init__(self, words, before=""):
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(PRELOADED)
        pipes = [os.pipe() for _ in range(3)]
        its = [pipes[0][0], pipes[1][1], pipes[2][1]]
        self._process = context.Process(
            target=_be_iout,
            args=(
                list(map(str, words)),
                [_Stream(descriptor) for descriptor in its],
                os.getcwd(),  # noqa: PTH109
                dict(os.environ),
                before,
            ),
        )
        self._process.start()
        for descriptor in its:
            os.close(descriptor)
        self.stdin = os.fdopen(pipes[0][1], "w")
        self.stdout, self.stderr = (os.fdopen(read) for read, _ in pipes[1:])

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
        """Close its input; what it wrote to output and error."""
        self.stdin.close()
        streams = (self.stdout, self.stderr)
        with ThreadPoolExecutor(2) as readers:
            texts = [readers.submit(stream.read) for stream in streams]
            try:
                self.wait(timeout)
            except subprocess.TimeoutExpired:
                self.kill()
                raise
            found = tuple(text.result() for text in texts)
        for stream in streams:
            stream.close()
        return found

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for stream in (self.stdin, self.stdout, self.stderr):
            stream.close()
        try:
            self.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.kill()
            raise


def run(*words, before=""):
    """Run `iout` to its end, like `subprocess.run`."""
    with Iout(words, before) as process:
        out, err = process.communicate(PATIENCE_S)
    return subprocess.CompletedProcess(list(words), process.returncode, out, err)
