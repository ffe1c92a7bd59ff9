"""All SQL of the service. Functions take a SQLAlchemy ``Session`` first and leave the commit to their caller.

blobs.py   uploaded bytes over fsspec            drives.py  drives and their life
roads.py   road import and extracts              dem.py     the set of elevation rasters
slopes.py  estimates, aggregates, segment reads  tracks.py  a drive's track
tiles.py   vector and GeoJSON tiles              stats.py   figures for operators
locks.py   the two locks that order writers      rows.py    what the functions return

Lock order, the same everywhere: the network lock, then the drive's row, then ``segments`` rows by id, then
the ``data_version`` row.
"""
