"""`python -m backend.service.jobs PARENT PULSE NAME`: a worker.

Apart from worker.py, which as a script would register its workflows a second time, under another module's name.
"""

from backend.service.jobs.worker import main

main()
