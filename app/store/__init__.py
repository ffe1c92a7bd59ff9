"""All SQL of the service. Functions take a SQLAlchemy ``Session`` first and leave the commit to their caller.

drives.py    drives and their life               queue.py      their jobs, in the same transaction
roads.py     road import and extracts            road_copy.py  a road table as binary COPY
dem.py       the set of elevation rasters        tracks.py     a drive's track
slopes.py    estimates, aggregates, version      segments.py   reading segments
tiles.py     vector and GeoJSON tiles            stats.py      figures for operators
locks.py     the lock that orders writers        rows.py       what the functions return
plain.py     values that PostgreSQL can hold     blobs.py      uploaded bytes over fsspec
databases.py whole databases                     http_*.py     what HTTP needs beside them

Lock order, the same everywhere: the network lock, then the drive's row, then ``segments`` rows by id, then
the ``data_version`` row.
"""
