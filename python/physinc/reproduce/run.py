"""Runs experiments side by side."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any

from .experiment import Experiment, Section, Task

PROCESSES = 2


def run(experiments: Sequence[Experiment], seeds: Sequence[int], done: Callable[[int, int, str], None]) -> list[Section]:
    """Do all tasks in two processes, then draw; `done` hears how many steps of how many are done, and which experiment is at work."""
    tasks: list[tuple[int, Task]] = [(i, task) for i, experiment in enumerate(experiments) for task in experiment.tasks(seeds)]
    steps = len(tasks) + len(experiments)
    results: list[Any] = [None] * len(tasks)
    others = multiprocessing.active_children()
    with ProcessPoolExecutor(PROCESSES, multiprocessing.get_context("spawn")) as pool:
        try:
            with unheard():
                futures = {pool.submit(task[0], *task[1]): index for index, (_, task) in enumerate(tasks)}
            for count, future in enumerate(as_completed(futures), 1):
                results[futures[future]] = future.result()
                done(count, steps, experiments[tasks[futures[future]][0]].name)
            drawings = []
            for i, experiment in enumerate(experiments):
                mine = [result for (of, _), result in zip(tasks, results, strict=True) if of == i]
                with unheard():
                    drawings.append(pool.submit(experiment.section, seeds, mine))
            sections = []
            for count, (experiment, drawing) in enumerate(zip(experiments, drawings, strict=True), len(tasks) + 1):
                sections.append(drawing.result())
                done(count, steps, f"{experiment.name}: figures")
        except BaseException:
            # Nobody waits for what they are at.
            for process in multiprocessing.active_children():
                if process not in others:
                    process.kill()
            raise
    return sections


@contextmanager
def unheard() -> Iterator[None]:
    """Let processes that begin here leave Ctrl-C to their parent, from their first instruction on; it hears of it once they have begun."""
    mask: Any = getattr(signal, "pthread_sigmask", None)  # Windows has none.
    if mask is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    # They inherit what is blocked. A library's thread (BLAS has some) doesn't block it, and Python then interrupts
    # the main thread, maybe between a process and what it is to read.
    came: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    blocked = mask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        mask(signal.SIG_SETMASK, blocked)
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)
