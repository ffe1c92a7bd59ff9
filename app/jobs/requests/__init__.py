"""The request machine: what is asked of a worker and followed until its end, whatever it is.

A request is a row with the columns of ``app.core.tables.requests`` and a job of the queue; both commit together. A
subject (exports, operations, trials) brings a ``RequestStore`` over its table and a ``RequestKind`` that says what a
run does. The machine does the rest: ``store`` adds, claims, puts back and ends rows, ``run`` performs a run and shows
how far it is, ``upkeep`` sees to what runs and requests left behind, ``listing`` shows them page by page.
"""
