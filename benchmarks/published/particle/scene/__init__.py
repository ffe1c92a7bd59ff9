"""A fictional place of the shape of the thesis's drive: ``calais`` lays out an ``interchange`` on a ``board``.

Roads follow an ``alignment``; elevation rasters are those of ``satellite_dem``.
"""
