"""All SQL of the service. Functions take a SQLAlchemy ``Session`` first and leave the commit to their caller.

drives.py    drives and their life               queue.py       their jobs, in the same transaction
batches.py   many drives processed again         tracks.py      a drive's track
slopes.py    what one drive says                 aggregates.py  what is published of a segment
passes.py    passes and their evidence           network.py     the network's slopes, solved around a change
rebuild.py   the whole network anew              version.py     the number of the published data
roads.py     road import                         road_copy.py   a road table as binary COPY
extracts.py  extracts of the roads               road_losses.py what an import takes from the network
dem.py       the set of elevation rasters        segments.py    reading segments
tiles.py     vector and GeoJSON tiles            stats.py       figures for operators
locks.py     the lock that orders writers        rows.py        what the functions return
plain.py     values that PostgreSQL can hold     blobs.py       uploaded bytes over fsspec
binary.py    statements with many bytes          identity.py    which database this is
databases.py whole databases                     http_*.py      what HTTP needs beside them

From drives to the map: ``drive_passes`` -> ``segment_evidence`` -> ``network_slopes`` -> ``segment_slopes``,
and ``drive_segments`` of slope-only drives -> ``segment_slopes``.

Lock order, the same everywhere: the network lock, then the drive's row, then the ``data_version`` row.
"""
