"""Runs experiments side by side."""

from __future__ import annotations

import multiprocessing
import signal
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
            with _unheard():
                futures = {pool.submit(task[0], *task[1]): index for index, (_, task) in enumerate(tasks)}
            for count, future in enumerate(as_completed(futures), 1):
                results[futures[future]] = future.result()
                done(count, steps, experiments[tasks[futures[future]][0]].name)
            drawings = []
            for i, experiment in enumerate(experiments):
                mine = [result for (of, _), result in zip(tasks, results, strict=True) if of == i]
                with _unheard():
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
def _unheard() -> Iterator[None]:
    """Let processes that begin here leave Ctrl-C to their parent, from their first instruction on."""
    mask: Any = getattr(signal, "pthread_sigmask", None)  # Windows has none.
    if mask is None:
        yield
        return
    # They inherit what is blocked; here it is heard afterwards.
    before = mask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        mask(signal.SIG_SETMASK, before)
