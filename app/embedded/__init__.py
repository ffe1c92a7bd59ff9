"""The embedded PostGIS of ``versant demo``, ``versant up`` and the tests. Knows no table of the service.

cluster.py      start, attach, stop                         binaries.py  finds PostgreSQL with PostGIS
data_folder.py  initialise, the server's settings, socket   account.py   the user that it runs as
postmaster.py   is a server running here?                   locks.py     locks between programs
errors.py       what can go wrong
"""
