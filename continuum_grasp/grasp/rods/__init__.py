"""Grasps of exact rods: one problem of small blocks for the plane and for space, solved by IPOPT.

`optimize.py` has the door `optimize_grasp`. `problem.py` writes the problem, `kinds.py`
its blocks, `supports.py` and `obstacles.py` what else is there, `geometry.py` the differences of plane and space,
`solving.py` the search from starts, `limits.py` and `repairs.py` the reasons, `verdict.py` the status, `projection.py`
the elements that stand for the rods, `optimize.py` the result; `answers.py` adds pushes, disturbances and stability,
`copies.py` and `robust.py` errors and histories;
`python -m benchmarks.bench_rods` compares grasps of random scenes with those of their images.
"""
