"""Archives of logs in bulk: ``versant batch``. Stages whose results stay in a folder, by any number of Dask workers.

Nothing is estimated here: one drive is ``fusion.pipeline``'s affair, several as one network ``fusion.together``'s.
"""
