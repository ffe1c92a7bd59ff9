"""The whole job on data that it makes itself.

run.py    the job: town, database, imports, service, uploads, answers      score.py      slopes against the truth
files.py  what it leaves in its folder                                     baselines.py  what one has without it
"""

from app.demo.run import DemoError, DemoResult, demo_service, run_demo

__all__ = ["DemoError", "DemoResult", "demo_service", "run_demo"]
