"""What a box may use."""

from dataclasses import dataclass, fields

from mdrive_sumo.core.errors import InputError

MEBIBYTE = 1024**2


@dataclass(frozen=True, slots=True)
class BoxLimits:
    """Ceilings of one box, that is of all processes in it together unless said otherwise."""

    memory_bytes: int = 512 * MEBIBYTE
    """Kept by a memory cgroup; without one it is RLIMIT_AS, that is address space *per process*."""
    processes: int = 64
    """Processes and threads."""
    cpu_s: int = 120
    """CPU time of each process [s]: the backstop behind the evaluator's deadlines."""
    file_bytes: int = 16 * MEBIBYTE
    """Largest single file, in the temporary folder or in shared memory."""
    tmp_bytes: int = 64 * MEBIBYTE
    """Size of `/tmp`, and again of `/dev/shm`; both count into the memory."""
    open_files: int = 128
    log_bytes: int = 64 * 1024
    """How much of the end of standard output and error is kept."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value: object = getattr(self, field.name)
            if type(value) is not int or value < 1:
                raise InputError(f"limits of the sandbox, {field.name}: expected a positive integer, found {value!r}")
