"""Archives of logs in bulk: ``versant batch``, stages whose results stay in a folder, by any number of Dask workers.

``versant import-batch`` brings these into a service. Nothing is estimated here: one drive is ``fusion.pipeline``'s
affair, several as one network ``fusion.together``'s.
"""
