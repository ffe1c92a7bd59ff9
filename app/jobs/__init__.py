"""The job queue: what a task is, how a worker runs them, and what becomes of one that is cut off. Knows no subject.

The queue is procrastinate. What stands here beside it, its release 3.10 does not do:

- ``worker.Watchdog``: its worker waits without a bound for side tasks that it has cancelled, and hangs where one of
  them lost its cancellation (procrastinate-org/procrastinate, issues 1591 and 1513, open).
- ``computations``: it counts attempts, and does not tell a job that kills its worker from one whose worker was stopped
  or cut off. ``runs`` gives up the one and repeats the other.
- ``stopping``: its graceful shutdown asks a job to abort, and waits for threads that do not hear it.
- ``worker``: its heartbeats find jobs of silent workers, and leave it to the user to put them back. A job whose
  end could not be written stays "doing".
"""
