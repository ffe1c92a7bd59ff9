/** The elevation model against the drives, tile by tile, the worst first. */
import { number, percent } from "../../shared/format";
import { t } from "../../shared/texts";
import { boxOfTile, mapOfBox, queryAddress } from "../links";
import { useQuery } from "../page_state";
import { AsOf, Loaded } from "../parts/Section";
import { Table } from "../parts/Table";
import type { TerrainTile } from "../types";

export function Terrain() {
  return (
    <>
      <p>{t("admin.terrain.what")}</p>
      <Loaded of={useQuery<TerrainTile>("terrain", 60)}>
        {(answer) => (
          <>
            <Table
              caption={t("admin.terrain.caption")}
              none={t("admin.terrain.none")}
              rows={answer.rows}
              csv={queryAddress("terrain")}
              columns={[
                {
                  title: t("admin.terrain.tile"),
                  cell: (row) => <a href={mapOfBox(boxOfTile(row.tile), "difference")}>{row.tile}</a>,
                },
                {
                  title: t("admin.terrain.mean"),
                  number: true,
                  cell: (row) => percent(row.mean_difference_percent, 2),
                },
                {
                  title: t("admin.terrain.rms"),
                  number: true,
                  cell: (row) => `${number(row.rms_difference_percent, 2)} %`,
                },
                {
                  title: t("admin.terrain.sigma"),
                  number: true,
                  cell: (row) => `${number(row.rms_sigma_percent, 2)} %`,
                },
                { title: t("admin.terrain.segments"), number: true, cell: (row) => number(row.segments) },
                { title: t("admin.terrain.km"), number: true, cell: (row) => number(row.km, 1) },
              ]}
            />
            <AsOf answer={answer} />
          </>
        )}
      </Loaded>
    </>
  );
}
