"""The embedded PostGIS of ``versant demo``, ``versant up`` and the tests.

binaries.py  finds PostgreSQL with PostGIS      account.py   the user that it runs as
cluster.py   initialise, start, attach, stop    config.py    the server's settings
lockfile.py  is a server running here?          sockets.py   the private folder of its socket
locks.py     locks between programs             errors.py    what can go wrong
"""
