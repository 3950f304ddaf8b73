"""`physinc reproduce`: the paper's experiments on simulated counterparts of its set-ups, every figure and table side by side with its own.

Each experiment is a module: `tasks(seeds)` are what can be done side by side, `section(results)` draws what came of them.
"""
