"""Processes forked from one that has imported what they need: imports take a second, a fork some 20 ms.

The server is started as a command and runs one thread, so nothing of the process that asks for workers,
be it a notebook with threads of its own, comes into a fork. It forks and reaps, and never runs a job:
what crashes in a job ends one worker. Over one socket

    driver → server    one byte, with two descriptors: a worker's standard input and output
    server → driver    pid, RUNNING; and when that ends pid, exit status

The server ends when the driver does, or closes the socket; and the workers with the server, whatever
ends it (the kernel's PR_SET_PDEATHSIG, of Linux; elsewhere libraries of the system do not survive a
fork, and each worker is a command of its own).
"""

from __future__ import annotations

import ctypes
import gc
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from typing import NoReturn

from ampi.workers.software import software

SUPPORTED = sys.platform == "linux"
PR_SET_PDEATHSIG = 1
_TOLD = struct.Struct("=qi")  # pid, exit status
RUNNING = 2**30  # no exit status


def serve(module: str, control: int) -> NoReturn:
    """Fork a worker whenever one is asked for on the socket `control`; its jobs need `module`."""
    from ampi.workers.worker import work

    os.dup2(2, 1)
    import_module(module)
    software()
    gc.freeze()
    hear, tell = os.pipe()
    os.set_blocking(hear, False)
    os.set_blocking(tell, False)
    signal.set_wakeup_fd(tell)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    workers = set[int]()
    with socket.socket(fileno=control) as driver:
        while True:
            ready, _, _ = select.select([driver.fileno(), hear], [], [])
            if hear in ready:
                with suppress(BlockingIOError):
                    os.read(hear, 4096)
                _reap(driver, workers)
            if driver.fileno() in ready:
                asked, descriptors, _, _ = socket.recv_fds(driver, 1, 2)
                if not asked:
                    _end(workers)
                server, pid = os.getpid(), os.fork()
                if pid == 0:
                    _become_worker(server, descriptors)
                    driver.close()
                    os.close(hear)
                    os.close(tell)
                    work()
                workers.add(pid)
                with suppress(OSError):  # it has ended, or done it itself
                    os.setpgid(pid, pid)
                for descriptor in descriptors:
                    os.close(descriptor)
                _tell(driver, pid, RUNNING)


def _become_worker(server: int, descriptors: Sequence[int]) -> None:
    """What a command of its own would have: its group, its pipes, no handlers of ours."""
    os.setpgid(0, 0)
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != server:  # it has ended before
        os._exit(0)
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    for standard, descriptor in enumerate(descriptors):
        os.dup2(descriptor, standard)
        os.close(descriptor)


def _end(workers: set[int]) -> NoReturn:
    """Not before they have: what they have used is then on this process' account."""
    for pid in workers:
        os.kill(pid, signal.SIGKILL)
    for pid in workers:
        os.waitpid(pid, 0)
    os._exit(0)


def _reap(driver: socket.socket, workers: set[int]) -> None:
    with suppress(ChildProcessError):
        while True:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            workers.discard(pid)
            _tell(driver, pid, os.waitstatus_to_exitcode(status))


def _tell(driver: socket.socket, pid: int, status: int) -> None:
    try:
        driver.send(_TOLD.pack(pid, status))
    except OSError:
        os._exit(0)


class ForkedProcess:
    """A worker of a server, as far as a supervisor knows a `subprocess.Popen`."""

    def __init__(self, stdin: int, stdout: int) -> None:
        self.stdin, self.stdout = os.fdopen(stdin, "wb"), os.fdopen(stdout, "rb")
        self.returncode: int | None = None
        self.pid = 0  # not forked yet
        self.orphaned = False  # the server has ended: nobody knows how this one did
        self._ended = threading.Event()

    def poll(self) -> int | None:
        """Its exit status, None while it runs."""
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Its exit status, once it has ended."""
        if not self._ended.wait(timeout):
            raise subprocess.TimeoutExpired("worker", timeout or 0.0)
        assert self.returncode is not None
        return self.returncode

    def kill(self) -> None:
        """End it at once; if it has not been forked yet, it finds its input closed."""
        if not self.pid:
            self.stdin.close()
        elif self.returncode is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    def has_ended(self, status: int, *, orphaned: bool = False) -> None:
        """To be called once."""
        self.orphaned, self.returncode = orphaned, status
        self._ended.set()


class ForkServer:
    """A server as its driver sees it. Safe to use from threads."""

    def __init__(self, command: str, environment: Mapping[str, str]) -> None:
        self._control, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", command.format(control=theirs.fileno())],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
                env=environment,
            )
        self._lock = threading.Lock()
        self._asked = deque[ForkedProcess]()
        self._running = dict[int, ForkedProcess]()
        self._over: int | None = None  # the server's exit status
        threading.Thread(target=self._listen, daemon=True).start()

    def fork(self) -> ForkedProcess:
        """One more worker, on its way."""
        jobs, send = os.pipe()
        receive, replies = os.pipe()
        process = ForkedProcess(send, receive)
        with self._lock:
            if self._over is None:
                self._asked.append(process)
                with suppress(OSError):  # it has just ended: `_listen` will say so
                    socket.send_fds(self._control, [b"!"], [jobs, replies])
            else:
                process.has_ended(self._over, orphaned=True)
        os.close(jobs)
        os.close(replies)
        return process

    def end(self) -> None:
        """At once, and all its workers."""
        with self._lock:
            if self._running:
                with suppress(OSError):
                    self._control.shutdown(socket.SHUT_WR)
            else:  # it may be importing still
                self.process.kill()

    def _listen(self) -> None:
        """What becomes of the workers, until the end of the server."""
        with self._control:
            with suppress(OSError):
                while told := self._control.recv(_TOLD.size):
                    pid, status = _TOLD.unpack(told)
                    with self._lock:
                        if status == RUNNING:
                            process = self._running[pid] = self._asked.popleft()
                            process.pid = pid
                        else:
                            self._running.pop(pid).has_ended(status)
            with self._lock:
                self._over = self.process.wait()
                for process in (*self._asked, *self._running.values()):
                    process.has_ended(self._over, orphaned=True)
