"""Roads: OSM files to node-pair segments, segments on a metric plane with an index."""
