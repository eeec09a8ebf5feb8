"""Processes for work that may crash, hang, take all memory or do harm.

A `Preparer` starts one process, which imports a module once and forks another for each request; `Worker` is the server's end of
such a one. It is executed anew, with few variables of the environment and none of the server's descriptors, and `confine`s
itself before it imports the module. Messages are JSON of limited length; what may be long leaves it as bytes, in pieces.

`python -m humanplay.tasks.processes MODULE ARGUMENT SETTINGS DESCRIPTOR` is that process. Its module has

    prepare(argument)        called once, before any request
    work(argument, request)  a generator. It yields an answer and is sent a question, in turns. A whole number instead of an
                             answer says how much of it is done, and that it goes on: it is sent nothing then
"""

from __future__ import annotations

import asyncio
import ctypes
import json
import logging
import os
import pwd
import resource
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import weakref
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle, send_handle
from pathlib import Path
from typing import Any, NoReturn

from humanplay.jobs import give_way, held

STEP_CPU_S = 2.0
"""Seconds of processor from one yield of a worker to the next."""
START_S = 120.0
"""Seconds in which a module must be imported and prepared."""
WAIT_S = 30.0
"""Seconds until nobody waits for an answer any longer."""
MESSAGE_BYTES = 32 * 2**20
LOOK_S = 0.05
"""How often the memory of a worker that has not answered is looked at."""
PROGRESS_S = 0.2
"""A worker says no more often than this how much is done."""
MOST_OF_TRACEBACK = 4000
"""Characters of a traceback that leave a worker, its end."""
KEPT = (
    "PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "VIRTUAL_ENV",
    "GLIBC_TUNABLES", "NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE",
)  # fmt: skip
FIXED = {
    "PYTHONHASHSEED": "0",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "SDL_VIDEODRIVER": "dummy",
    "SDL_AUDIODRIVER": "dummy",
}
SYSTEM = ("/usr", "/lib", "/lib64", "/bin", "/etc", "/proc", "/sys", "/opt")
"""What a worker may read beside Python's own folders and its packages."""
SHARED = ("shm", "mqueue")
"""What in /dev is memory and messages of all programs, and no device."""
OTHER_USER, NO_NETWORK, NO_OTHER_FILES = "another user", "no network", "no other files"

PIECE_BYTES = 2**20
"""Most bytes of one piece of an answer."""
MOST_BYTES = 512 * 2**20
"""Most bytes of one answer."""
MORE, LAST = b"\x00", b"\x01"
"""What a piece begins with; a message of JSON begins with a brace."""


_log = logging.getLogger(__name__)

Binary = tuple[Any, bytes]
"""An answer in pieces: what JSON holds, and bytes."""
Work = Generator[Any, Any, None]


class LostError(Exception):
    """A worker is gone or gave no answer; the text says what it did.

    Its cause is a `RaisedError` where the worker's code raised.
    """


class RaisedError(Exception):
    """What the code in a worker raised; the text is its traceback there."""


def variables() -> dict[str, str]:
    """Environment variables of a worker: the fixed ones, and a few of this process's."""
    paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path)
    inherited = {name: os.environ[name] for name in KEPT if name in os.environ}
    return inherited | FIXED | {"PYTHONPATH": paths}


def start_process(
    words: tuple[str, str, str], connection: int, environ: Mapping[str, str], folder: Path
) -> subprocess.Popen[bytes]:
    """Start the process of a `Preparer`, which inherits one descriptor.

    Args:
        words: Its module, its argument, and its settings as JSON.
        connection: Over which it is sent its requests.
    """
    return subprocess.Popen(
        [sys.executable, "-m", "humanplay.tasks.processes", *words, str(connection)],
        env=environ,
        cwd=folder,
        pass_fds=[connection],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


class Preparer:
    """A process that forks workers; started when needed, and again if it is gone.

    Args:
        memory_mb: Resident memory that a worker may take beyond the preparer's.
        readable: Further files and folders that workers may read.
        hidden: Files and folders that they may not read although a folder above is readable; and
            files whose names begin like theirs.
        confined: False lets workers do what the user may, in the user's folders and network.
    """

    def __init__(
        self,
        module: str,
        argument: str,
        memory_mb: int = 512,
        readable: Sequence[Path] = (),
        hidden: Sequence[Path] = (),
        confined: bool = True,
    ) -> None:
        self._module, self.argument, self._allowed = module, argument, memory_mb << 20
        self._settings = {
            "readable": [str(path.resolve()) for path in readable],
            "hidden": [str(path.resolve()) for path in hidden],
            "confined": confined,
        }
        self._changing = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection
        self._ended: weakref.finalize[..., Preparer]
        self.folder: Path
        self._guards: dict[str, str] = {}

    def guards(self) -> Mapping[str, str]:
        """Guard of the workers -> "" or why it is off.

        Raises:
            ValueError: If the process does not start.
        """
        with self._changing:
            self._running_process()
        return self._guards

    def begin(self, request: Mapping[str, object]) -> Worker:
        """A new worker, whose first answer is still to come; ValueError if there is none."""
        mine, theirs = socket.socketpair()
        with mine, self._changing, theirs:
            for attempt in (0, 1):
                try:
                    process = self._running_process()
                    self._connection.send_bytes(json.dumps(request).encode())
                    send_handle(self._connection, theirs.fileno(), process.pid)
                    message = self._receive()
                    break
                except (OSError, EOFError) as error:
                    self.close()
                    if attempt:
                        raise ValueError(
                            f"the process of {self.argument} has ended and does not start again"
                        ) from error
            connection = Connection(mine.detach())
        return Worker(connection, message["pid"], message["resident"], self._allowed)

    def _receive(self) -> dict[str, Any]:
        if not self._connection.poll(START_S):
            raise OSError(f"no answer in {START_S:g} s")
        message: dict[str, Any] = json.loads(self._connection.recv_bytes(MESSAGE_BYTES))
        return message

    def _running_process(self) -> subprocess.Popen[bytes]:
        if self._process is not None:
            return self._process
        mine, theirs = socket.socketpair()
        self.folder = Path(tempfile.mkdtemp(prefix="humanplay-"))
        with mine, theirs:
            environ = variables()
            place = Path.cwd()
            if self._settings["confined"]:
                place = self.folder
                environ |= {"HOME": str(place), "TMPDIR": str(place)}
            elif "HOME" in os.environ:
                environ["HOME"] = os.environ["HOME"]
            words = self._module, self.argument, json.dumps(self._settings)
            self._process = start_process(words, theirs.fileno(), environ, place)
            self._connection = Connection(mine.detach())
        self._ended = weakref.finalize(self, _end, self._process, self._connection, self.folder)
        try:
            self._connection.send_bytes(json.dumps(held.payloads()).encode())
            message = self._receive()
        except (OSError, EOFError):
            self.close()
            raise
        if "error" in message:
            self.close()
            if trace := message["traceback"]:
                _log.error("%s cannot be prepared:\n%s", self.argument, trace)
            raise ValueError(message["error"])
        self._guards = message["guards"]
        return self._process

    def close(self) -> None:
        """End the process and all workers.

        The same happens at exit, and when nothing refers to this object any more.
        """
        if self._process is not None:
            self._ended()
            self._process = None


def _end(process: subprocess.Popen[bytes], connection: Connection, folder: Path) -> None:
    connection.close()
    process.kill()
    process.wait()
    shutil.rmtree(folder, ignore_errors=True)


class Worker:
    """The server's end of a worker's process.

    Args:
        pid: None if a program answers that we neither measure nor end.
        shared: Bytes of resident memory that its preparer has, which count once.
        allowed: Bytes that it may take beyond them.
    """

    def __init__(self, connection: Connection, pid: int | None, shared: int, allowed: int) -> None:
        self.connection, self.pid, self._shared, self._allowed = connection, pid, shared, allowed
        self._bytes, self._pieces = bytearray(), bytearray()
        self._message_read = dict[str, Any]()
        self._ready = select.poll()
        self._ready.register(connection.fileno(), select.POLLIN)

    def resident(self) -> int:
        """Resident memory that it takes beyond its preparer's, in bytes."""
        if self.pid is None or self.connection.closed:
            return 0
        return max(0, _resident(self.pid) - self._shared)

    def ask(self, question: Any) -> Any:
        """The answer to a question; `LostError` if there is none."""
        self._send(question)
        return self.answer()

    async def ask_without_thread(self, question: Any) -> bool:
        """Send a question; False if `answer` must wait for it on a thread.

        In the first LOOK_S, which are enough for most answers, the event loop waits for it. A thread
        for it would take a third of what a move costs a server.

        Raises:
            LostError: If it cannot be sent.
        """
        self._send(question)
        loop, number = asyncio.get_running_loop(), self.connection.fileno()
        came: asyncio.Future[None] = loop.create_future()

        def end() -> None:
            if not came.done():
                came.set_result(None)

        def read() -> None:
            try:
                self._read()
                self._message_read = self._message()
            except (EOFError, OSError, ValueError):
                self._message_read = {"lost": True}
            if self._message_read:
                end()

        loop.add_reader(number, read)
        late = loop.call_later(LOOK_S, end)
        try:
            await came
        finally:
            late.cancel()
            loop.remove_reader(number)
        return "answer" in self._message_read

    def _send(self, question: Any) -> None:
        try:
            self.connection.send_bytes(json.dumps(question).encode())
        except OSError as error:
            raise LostError("its process had ended") from error

    def _read(self) -> None:
        """Receive a part of a message.

        Raises:
            EOFError: If the other end is closed.
            OSError: If the message is too long.
        """
        if not (came := os.read(self.connection.fileno(), 2**18)):
            raise EOFError
        self._bytes += came
        if not 0 <= int.from_bytes(self._bytes[:4], "big", signed=True) <= MESSAGE_BYTES:
            raise OSError("its message is too long")

    def _message(self) -> dict[str, Any]:
        """The next message, framed by `Connection.send_bytes`; empty if it is incomplete."""
        end = 4 + int.from_bytes(self._bytes[:4], "big")
        if len(self._bytes) < max(5, end):
            return {}
        content = bytes(self._bytes[4:end])
        del self._bytes[:end]
        if content[:1] not in (MORE, LAST):
            message: dict[str, Any] = json.loads(content)
            return message
        self._pieces += content[1:]
        if len(self._pieces) > MOST_BYTES:
            raise OSError("its answer is too long")
        return self._message() if content[:1] == MORE else self._joined()

    def _joined(self) -> dict[str, Any]:
        """The answer of all pieces, once the last one has come."""
        whole, self._pieces = bytes(self._pieces), bytearray()
        end = 4 + int.from_bytes(whole[:4], "big")
        return {"answer": (json.loads(whole[4:end]), whole[end:])}

    def answer(self, progress: Callable[[int], object] = lambda done: None) -> Any:
        """The next answer; `LostError` if none comes: then the process is ended.

        Args:
            progress: Called with how much is done, now and then.
        """
        try:
            message = self._wait_for_answer(progress)
        except LostError:
            self.close(kills=True)
            raise
        if "error" in message:
            self.close(kills=True)
            raise LostError(message["error"]) from RaisedError(message["traceback"])
        return message["answer"]

    def _wait_for_answer(self, progress: Callable[[int], object]) -> dict[str, Any]:
        due = time.monotonic() + WAIT_S
        while True:
            try:
                message, self._message_read = self._message_read, {}
                if not message and self._ready.poll(1000 * LOOK_S):
                    self._read()
                message = message or self._message()
                if "done" in message:
                    progress(message["done"])
                    due = time.monotonic() + WAIT_S
                elif message and "lost" not in message:
                    return message
            except (EOFError, OSError) as error:
                raise LostError(
                    f"its process ended by itself, by a crash or after {STEP_CPU_S:g} s of processor"
                ) from error
            if (taken := self.resident()) > self._allowed:
                raise LostError(
                    f"it took {taken >> 20} MB of memory, of at most {self._allowed >> 20} MB"
                )
            if time.monotonic() > due:
                raise LostError(f"it gave no answer in {WAIT_S:g} s")

    def close(self, kills: bool = False) -> None:
        """Let the process end; it reads that nobody listens any more."""
        self.connection.close()
        if kills and self.pid is not None and _resident(self.pid):
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)


def _resident(pid: int) -> int:
    """Resident memory of a process in bytes; 0 if it is unknown."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize()
    except (OSError, IndexError):
        return 0


def serve(name: str, argument: str, settings_json: str, descriptor: int) -> None:
    """Fork a worker for each request, until nobody asks any more."""
    connection, settings = Connection(descriptor), json.loads(settings_json)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    give_way(5)  # a worker that takes all it can get gives way to the server
    try:
        held.take(json.loads(connection.recv_bytes()))
        guards = {}
        if settings["confined"]:
            guards = confine(settings["readable"], settings["hidden"], Path.cwd())
        module = import_module(name)
        module.prepare(argument)
    except Exception as error:
        failure = {"error": _said(error), "traceback": "" if _is_ours(error) else _trace_of(error)}
        connection.send_bytes(json.dumps(failure).encode())
        return
    connection.send_bytes(json.dumps({"guards": guards}).encode())
    while True:
        try:
            request = json.loads(connection.recv_bytes(MESSAGE_BYTES))
            worker = recv_handle(connection)
        except EOFError:
            return
        if (pid := os.fork()) == 0:
            connection.close()
            _work(module.work, argument, request, Connection(worker))
        os.close(worker)
        message = {"pid": pid, "resident": _resident(os.getpid())}
        connection.send_bytes(json.dumps(message).encode())


def _work(
    work: Callable[[str, Any], Work], argument: str, request: Any, connection: Connection
) -> NoReturn:
    """Answer in a process forked for one request, until nobody asks any more."""
    with suppress(AttributeError):  # of Linux alone; elsewhere it ends when nobody listens any more
        _libc().prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: it ends with what forked it
    reported_at = time.monotonic()
    try:
        _timed()
        doing = work(argument, request)
        answer = next(doing)
        while True:
            if isinstance(answer, int):
                if time.monotonic() - reported_at > PROGRESS_S:
                    connection.send_bytes(json.dumps({"done": answer}).encode())
                    reported_at = time.monotonic()
                question = None
            else:
                send_answer(connection, answer)
                signal.setitimer(signal.ITIMER_PROF, 0)
                question = json.loads(connection.recv_bytes(MESSAGE_BYTES))
            _timed()
            answer = doing.send(question)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        os._exit(0)
    except BaseException as error:
        send_failure(connection, error)
        os._exit(1)


def send_failure(connection: Connection, error: BaseException) -> None:
    """Send what was raised instead of an answer, with its traceback."""
    failure = {"error": _said(error), "traceback": _trace_of(error)}
    connection.send_bytes(json.dumps(failure).encode())


def _trace_of(error: BaseException) -> str:
    return "".join(traceback.format_exception(error))[-MOST_OF_TRACEBACK:]


def _is_ours(error: BaseException) -> bool:
    """Whether code of this package raised an error, whose text then says all."""
    (*_, (innermost, _)) = traceback.walk_tb(error.__traceback__)
    return str(innermost.f_globals.get("__name__")).startswith("humanplay.")


def send_answer(connection: Connection, answer: Any) -> None:
    """Send an answer: as JSON, or what is `Binary` in pieces."""
    if not isinstance(answer, tuple):
        connection.send_bytes(json.dumps({"answer": answer}).encode())
        return
    about = json.dumps(answer[0]).encode()
    whole = len(about).to_bytes(4, "big") + about + answer[1]
    for start in range(0, len(whole), PIECE_BYTES):
        end = start + PIECE_BYTES
        connection.send_bytes((LAST if end >= len(whole) else MORE) + whole[start:end])


def _timed() -> None:
    """Let the system end this process by SIGPROF after so much of the processor."""
    signal.setitimer(signal.ITIMER_PROF, STEP_CPU_S)


def _said(error: BaseException) -> str:
    return (str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}")[
        :500
    ]


def confine(readable: Iterable[str], hidden: Iterable[str], folder: Path) -> dict[str, str]:
    """Take from this process for good what it does not need.

    Returns:
        Guard -> "", or why it is off.

    OTHER_USER      it becomes `nobody`, where it is root's and `nobody` can read its packages
    NO_NETWORK      a network namespace of its own without interfaces
    NO_OTHER_FILES  Landlock: it reads the system, Python, its packages and what is `readable`, and writes to `folder`

    Call it before threads start: each of them would stay as it was.
    """
    may_read = [*SYSTEM, sys.prefix, sys.base_prefix, *filter(None, sys.path), *readable]
    guards: dict[str, Callable[[], None]] = {
        NO_NETWORK: _leave_network,
        OTHER_USER: lambda: _become_nobody(may_read, folder),
        NO_OTHER_FILES: lambda: _keep_to(may_read, [*hidden], folder),
    }
    reasons = {}
    for name, guard in guards.items():
        try:
            guard()
        except AttributeError as error:  # another system than Linux
            reasons[name] = f"this system has none: {error}"
        except (OSError, KeyError) as error:
            reasons[name] = getattr(error, "strerror", None) or str(error)
        else:
            reasons[name] = ""
    _drop_capabilities()
    return reasons


def guards_of(guards: Mapping[str, str]) -> str:
    """The guards of `confine` in a sentence: what is on, and what is off and why."""
    if not guards:
        return "boards run in processes of their own, which may do what you may"
    on = [name for name, reason in guards.items() if not reason]
    sentence = f"boards run in processes of their own, with {', '.join(on) or 'no further guard'}"
    if off := [f"{name} ({reason})" for name, reason in guards.items() if reason]:
        sentence += f"; not with {', '.join(off)}"
    if guards[OTHER_USER]:
        sentence += ". Without another user this guards against faults, not against malice"
    return sentence


def _drop_capabilities() -> None:
    """Take from root its rights over other users' files and the system."""
    with suppress(AttributeError):
        _libc().capset(struct.pack("Ii", 0x20080522, 0), bytes(24))  # linux/capability.h, version 3


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _checked(result: int) -> int:
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return result


NEW_NETWORK, NEW_USER = 0x40000000, 0x10000000
"""CLONE_NEWNET and CLONE_NEWUSER; the second lets a user who is not root have the first, where the system permits it."""


def _leave_network() -> None:
    user = os.getuid()
    _checked(_libc().unshare(NEW_NETWORK | (NEW_USER if user else 0)))
    if user:
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1")


def _become_nobody(may_read: Iterable[str], folder: Path) -> None:
    if os.getuid() != 0:
        raise OSError(0, "the server is not root's")
    nobody = pwd.getpwnam("nobody")
    groups = os.getgroups()
    os.setgroups([])
    os.setegid(nobody.pw_gid)
    os.seteuid(nobody.pw_uid)
    needed = [path for path in (*may_read, __file__, sys.executable) if path not in SYSTEM]
    unreadable = [path for path in needed if not _may_read(path)]
    os.seteuid(0)
    if unreadable:
        os.setegid(0)
        os.setgroups(groups)
        raise OSError(0, f"the user nobody cannot read {unreadable[0]}")
    os.chown(folder, nobody.pw_uid, nobody.pw_gid)
    os.setgid(nobody.pw_gid)
    os.setuid(nobody.pw_uid)


def _may_read(path: str) -> bool:
    """Whether the effective user can read a path; True for a missing one."""
    try:
        is_folder = Path(path).is_dir()
        Path(path).stat()
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return os.access(path, os.R_OK | (os.X_OK if is_folder else 0), effective_ids=True)


CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
"""Landlock's system calls, by the same numbers everywhere (linux/landlock.h)."""
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR, TRUNCATE, IOCTL_DEV = 1, 2, 4, 8, 1 << 14, 1 << 15
OF_A_FILE = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | IOCTL_DEV
"""What a rule for a file may say."""
HANDLED = (0, 13, 14, 15, 15, 16)
"""By the version of Landlock, how many kinds of access to files it knows; later ones know no more."""
RULE_OF_A_PATH = 1
BIND_AND_CONNECT, SOCKETS_AND_SIGNALS = 0b11, 0b11
"""TCP, of version 4; abstract sockets and signals of other processes, of version 6."""
ATTRIBUTES_BYTES = (8, 8, 8, 8, 16, 16, 24)
"""By the version, how much of the attributes it takes: files, then TCP, then sockets and signals."""
NO_NEW_PRIVILEGES = 38
"""Of prctl: without it nobody may restrict a process."""


def _keep_to(may_read: Iterable[str], hidden: Sequence[str], folder: Path) -> None:
    """Restrict files by Landlock, and what else it can: TCP, sockets, signals.

    Raises:
        OSError: If the system has no Landlock.
    """
    if sys.platform != "linux":  # where these numbers are other calls
        raise OSError(0, "this system has no Landlock")
    libc = _libc()
    version = _checked(libc.syscall(CREATE_RULESET, None, 0, 1))
    every = (1 << HANDLED[min(version, len(HANDLED) - 1)]) - 1
    attributes = struct.pack("QQQ", every, BIND_AND_CONNECT, SOCKETS_AND_SIGNALS)
    size = ATTRIBUTES_BYTES[min(version, len(ATTRIBUTES_BYTES) - 1)]
    ruleset = _checked(libc.syscall(CREATE_RULESET, attributes, size, 0))
    rules = dict.fromkeys(_readable(may_read, hidden), EXECUTE | READ_FILE | READ_DIR)
    rules |= dict.fromkeys(_parted(may_read, hidden), READ_DIR)
    devices = [
        str(device)
        for device in Path("/dev").iterdir()
        if device.name not in SHARED and not device.is_symlink()
    ]
    rules |= dict.fromkeys(devices, READ_FILE | READ_DIR | WRITE_FILE | IOCTL_DEV)
    rules[str(folder)] = every
    for path, access in rules.items():
        with suppress(FileNotFoundError, PermissionError):
            opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
            allowed = access & every & (-1 if Path(path).is_dir() else OF_A_FILE)
            rule = struct.pack("=Qi", allowed, opened)
            _checked(libc.syscall(ADD_RULE, ruleset, RULE_OF_A_PATH, rule, 0))
            os.close(opened)
    _checked(libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0))
    _checked(libc.syscall(RESTRICT_SELF, ruleset, 0))
    os.close(ruleset)


def _readable(paths: Iterable[str], hidden: Sequence[str]) -> Iterator[str]:
    """The paths; instead of one with hidden files in it, its other content."""
    for path in map(os.path.realpath, paths):
        if any(path.startswith(secret) for secret in hidden):
            continue
        if (
            any(secret.startswith(path.rstrip("/") + "/") for secret in hidden)
            and Path(path).is_dir()
        ):
            yield from _readable([str(child) for child in Path(path).iterdir()], hidden)
        else:
            yield path


def _parted(paths: Iterable[str], hidden: Sequence[str]) -> Iterator[str]:
    """Folders of which not everything may be read; their names may be listed."""
    for path in map(os.path.realpath, paths):
        if any(secret.startswith(path.rstrip("/") + "/") for secret in hidden):
            yield path


if __name__ == "__main__":
    serve(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]))
