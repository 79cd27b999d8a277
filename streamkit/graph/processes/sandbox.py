"""Restricts a child process to what it needs, before it handles the stream.

Source: the kernel's documentation of Landlock and of seccomp filters (userspace-api/landlock.rst,
userspace-api/seccomp_filter.rst).
"""

from __future__ import annotations

import ctypes
import os
import platform
import resource
import struct
import sys
from collections.abc import Iterable
from pathlib import Path

from streamkit.crossing.shared_memory import LIBC
from streamkit.errors import ResourceError

PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, SECCOMP_MODE_FILTER = 38, 22, 2
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446  # system calls, the same on every machine
RULE_PATH_BENEATH, RULESET_VERSION = 1, 1
MIN_VERSION, VERSION_WITH_SCOPES = 3, 6  # Linux 6.2 and 6.12
WRITE_FILE, READ_FILE, READ_DIR = 1 << 1, 1 << 2, 1 << 3
EVERY_ACCESS = (1 << 15) - 1  # of version 3: also executing, making, removing, renaming, truncating
SCOPES = 0b11  # abstract sockets and signals of other processes
READABLE = (
    "/usr", "/lib", "/lib64", "/etc", "/proc", "/sys", "/dev", "/run/systemd/resolve", "/opt",
)  # fmt: skip
WRITABLE = ("/dev/null",)

# Numbers of x86-64, by what the calls do.
REFUSED = (
    57, 58, 59, 322,  # start programs or processes: fork vfork execve execveat
    101, 310, 311, 312, 424, 438, 440,  # look into others: ptrace process_vm_* kcmp pidfd_* process_madvise
    155, 161, 165, 166, 304, 428, 429, 430, 431, 432, 442,  # change what is mounted, or open around it
    272, 308,  # leave namespaces: unshare setns
    248, 249, 250,  # use the kernel's keys
    135, 298, 321, 323, 425, 426, 427,  # personality perf_event_open bpf userfaultfd io_uring_*
    163, 164, 167, 168, 169, 172, 173, 175, 176, 179, 227, 246, 313, 320,  # administer the machine
)  # fmt: skip
CLONE, CLONE3, CLONE_THREAD, FIRST_X32 = 56, 435, 0x10000, 0x40000000
AUDIT_ARCH_X86_64 = 0xC000003E
ALLOW, ERRNO, KILL = 0x7FFF0000, 0x00050000, 0x80000000
EPERM, ENOSYS = 1, 38
LOAD, EQUAL, AT_LEAST, HAS_BITS, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
NUMBER_AT, ARCHITECTURE_AT, FIRST_ARGUMENT_AT = 0, 4, 16


def enter_sandbox(files: Iterable[str]) -> str:
    """Restricts this process and all threads that it starts from now on, for good.

    Args:
        files: that may be read, in addition to those of Python, its packages and the system.

    Returns:
        What does not hold here, in words, or "".

    Raises:
        ResourceError: the kernel cannot do it, or threads are running that would not be restricted.
    """
    if len(os.listdir("/proc/self/task")) > 1:
        raise ResourceError("sandbox: a library has started threads when it was imported; omit sandbox")
    version = LIBC.syscall(CREATE_RULESET, None, 0, RULESET_VERSION)
    if version < MIN_VERSION:
        raise ResourceError(
            f"sandbox needs Landlock of Linux 6.2 or newer, enabled at boot, got version {version}; omit "
            "sandbox, or start Linux with landlock among its lsm="
        )
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _demand(LIBC.prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0), "no_new_privs")
    _restrict_files(version, files)
    missing = [] if version >= VERSION_WITH_SCOPES else ["signals to other processes are not refused"]
    if platform.machine() == "x86_64":
        _filter_calls()
    else:
        missing.append(f"system calls are not filtered on {platform.machine()}")
    return "; ".join(missing)


def _restrict_files(version: int, files: Iterable[str]) -> None:
    """Only some files may be read, none written or executed."""
    scopes = struct.pack("<QQ", 0, SCOPES) if version >= VERSION_WITH_SCOPES else b""
    attributes = struct.pack("<Q", EVERY_ACCESS) + scopes
    ruleset = _demand(LIBC.syscall(CREATE_RULESET, attributes, len(attributes), 0), "Landlock")
    python = (sys.prefix, sys.base_prefix, *sys.path)
    for path in (*READABLE, *python, *files):
        _allow(ruleset, path, READ_FILE | READ_DIR)
    for path in WRITABLE:
        _allow(ruleset, path, READ_FILE | WRITE_FILE)
    _demand(LIBC.syscall(RESTRICT_SELF, ruleset, 0), "Landlock")
    os.close(ruleset)


def _allow(ruleset: int, path: str, access: int) -> None:
    """Allows an access to a file or to everything in a folder; a path that is not there needs no rule."""
    try:
        descriptor = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except (OSError, ValueError):
        return
    access &= ~0 if Path(path).is_dir() else ~READ_DIR
    rule = struct.pack("<Qi", access, descriptor)
    try:
        _demand(LIBC.syscall(ADD_RULE, ruleset, RULE_PATH_BENEATH, rule, 0), "Landlock")
    finally:
        os.close(descriptor)


def _filter_calls() -> None:
    """Refuses the calls of `REFUSED`, and new processes; threads are allowed."""

    def step(code: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
        """Packs an instruction; a comparison skips a number of the next ones, by its outcome."""
        return struct.pack("<HBBI", code, if_true, if_false, value)

    refuse = [step(RETURN, ERRNO | EPERM)]
    program = [
        step(LOAD, ARCHITECTURE_AT), step(EQUAL, AUDIT_ARCH_X86_64, 1), step(RETURN, KILL),
        step(LOAD, NUMBER_AT), step(AT_LEAST, FIRST_X32, 0, 1), *refuse,
    ]  # fmt: skip
    for number in REFUSED:
        program += [step(EQUAL, number, 0, 1), *refuse]
    program += [step(EQUAL, CLONE3, 0, 1), step(RETURN, ERRNO | ENOSYS)]  # the C library then calls clone
    program += [
        step(EQUAL, CLONE, 0, 3), step(LOAD, FIRST_ARGUMENT_AT), step(HAS_BITS, CLONE_THREAD, 1, 0), *refuse,
        step(RETURN, ALLOW),
    ]  # fmt: skip
    code = ctypes.create_string_buffer(b"".join(program))
    header = struct.pack("<HxxxxxxQ", len(program), ctypes.addressof(code))
    _demand(LIBC.prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, header, 0, 0), "the filter of system calls")


def _demand(result: int, what: str) -> int:
    if result < 0:
        raise ResourceError(f"sandbox: the kernel refuses {what}: {os.strerror(ctypes.get_errno())}")
    return result
