"""Slopes of drives in a few lines: logs, roads and elevation in; a GeoPackage, or any file geopandas writes, out.

python docs/files/example.py drive_01.csv drive_02.ubx --roads town.osm --dem dem.tif -o slopes.gpkg
"""

import argparse
from pathlib import Path

import fusion


def main() -> None:
    """Read, run, solve, write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--roads", required=True, type=Path)
    parser.add_argument("--dem", nargs="+", type=Path, default=[])
    parser.add_argument("-o", "--out", required=True, type=Path)
    given = parser.parse_args()

    roads = fusion.read_roads(given.roads)
    dem = fusion.Dem.open(given.dem) if given.dem else None
    drives = []
    for path in given.logs:
        network, result = fusion.run_drive(fusion.read_log(path), roads, dem)
        print(f"{path.name}: {len(result.slopes)} segments, {result.report['matched_share']:.0%} on roads")
        drives.append((network, result))

    solution = fusion.solve(drives, roads, dem)
    segments = fusion.segments_frame(solution)
    segments.to_file(given.out, layer="segments")
    print(f"{given.out.name}: {len(segments)} segments, heights above {solution.height_datum}")
    steep = segments.loc[segments.slope_percent.abs().idxmax()]
    print(
        f"steepest: {steep['name'] or 'unnamed'}, {steep.slope_percent:+.1f} ± {steep.slope_sigma_percent:.1f} %"
    )


if __name__ == "__main__":
    main()
