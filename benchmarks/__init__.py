"""Speed of pdssjax beside other ways to simulate and fit a stick-slip actuator: `python -m benchmarks.speed`.

`jobs` holds what is measured, one job a file, and `peers` who does it, one simulator a
file.  Nothing is registered: a new file is found by itself.
"""
