"""Memory of a process and all that it started, at its peak."""

from __future__ import annotations

import subprocess
import threading
import time
from pathlib import Path

_EVERY_S = 0.5


class TreeMemory:
    """Watches a running process from a thread.

    The proportional set size counts a page that several processes share once: the sum over processes is what the
    machine is short of (proc(5), ``smaps_rollup``).

    Attributes:
        peak_gb: largest sum of proportional set sizes that was seen [GB].
        rss_gb: largest sum of resident set sizes, shared pages counted in every process [GB].
    """

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.peak_gb = self.rss_gb = 0.0
        self._process = process
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def join(self) -> None:
        """Wait until the process has ended."""
        self._thread.join()

    def _watch(self) -> None:
        while self._process.poll() is None:
            found = [_memory(pid) for pid in _tree(self._process.pid)]
            self.peak_gb = max(self.peak_gb, sum(pss for pss, _ in found) / 2**20)
            self.rss_gb = max(self.rss_gb, sum(rss for _, rss in found) / 2**20)
            time.sleep(_EVERY_S)


def tree_memory(root: int) -> tuple[float, float]:
    """Memory that a process took for itself, and that of all its descendants together [MB].

    Proportional set size without pages of files: what libraries take of it rises and falls with other programs on
    the machine that use them too.
    """
    parent, *workers = (_sizes(pid) for pid in _tree(root))
    return _own(parent), sum(map(_own, workers))


def _own(sizes: dict[str, float]) -> float:
    return (sizes.get("Pss_Anon", 0.0) + sizes.get("Pss_Shmem", 0.0)) / 2**10


def _tree(root: int) -> list[int]:
    """A process and its descendants."""
    children: dict[int, list[int]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            after = path.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        children.setdefault(int(after[1]), []).append(int(path.parent.name))
    found = [root]
    for pid in found:
        found += children.get(pid, [])
    return found


def _memory(pid: int) -> tuple[float, float]:
    """Proportional and resident set size [kB]; zeros for a process that has ended."""
    sizes = _sizes(pid)
    return sizes.get("Pss", 0.0), sizes.get("Rss", 0.0)


def _sizes(pid: int) -> dict[str, float]:
    """What the kernel says of a process's memory, by name [kB]; nothing of a process that has ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return {}
    return {line.split(":")[0]: float(line.split()[1]) for line in lines if line.endswith("kB")}
