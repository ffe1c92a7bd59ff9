/** Regions and rasters: what there is, import, removal, computing again. */
import { moment, number } from "../../shared/format";
import { t } from "../../shared/texts";
import { reprocess } from "../actions/drives";
import { askFor, settle } from "../actions/operations";
import { mapOfBox } from "../links";
import { useReading } from "../page_state";
import { Loaded } from "../parts/Section";
import { Table } from "../parts/Table";
import type { Bounds, Raster, Region } from "../types";
import { ImportFile } from "./ImportFile";
import { Operations } from "./Operations";

function Place({ name, box }: { name: string; box: Bounds | null }) {
  return box ? <a href={mapOfBox(box)}>{name}</a> : <span>{name}</span>;
}

function resolution(one: Raster): string {
  if (one.resolution_m) return `${number(one.resolution_m, one.resolution_m < 10 ? 1 : 0)} m`;
  return one.resolution_deg ? `${number(one.resolution_deg * 3600, 1)}″` : "–";
}

function credit(one: Raster): string {
  return [one.source, one.licence].filter(Boolean).join(", ") || "–";
}

function Regions() {
  const again = (one: Region) =>
    void reprocess({ which: "all", region: one.name }, t("admin.regions.whom", { name: one.name }));
  return (
    <Loaded of={useReading<{ regions: Region[] }>("/v1/regions", 60)}>
      {({ regions }) => (
        <Table
          caption={t("admin.regions.caption")}
          none={t("admin.regions.none")}
          rows={regions}
          columns={[
            { title: t("admin.regions.name"), cell: (one) => <Place name={one.name} box={one.bbox} /> },
            { title: t("admin.regions.segments"), number: true, cell: (one) => number(one.segments) },
            {
              title: t("admin.regions.measured"),
              number: true,
              cell: (one) => <a href="#coverage">{number(one.measured)}</a>,
            },
            { title: t("admin.regions.source"), cell: (one) => one.source_name ?? "–" },
            { title: t("admin.regions.imported"), cell: (one) => moment(one.imported_at) },
            {
              title: t("admin.failures.acts"),
              cell: (one) => (
                <span class="acts">
                  <button
                    type="button"
                    aria-label={t("admin.regions.again_of", { name: one.name })}
                    onClick={() => again(one)}
                  >
                    {t("admin.regions.again")}
                  </button>
                  <button
                    type="button"
                    class="danger"
                    aria-label={t("admin.regions.remove_of", { name: one.name })}
                    onClick={() => void askFor("remove-region", one.name)}
                  >
                    {t("admin.regions.remove")}
                  </button>
                </span>
              ),
            },
          ]}
        />
      )}
    </Loaded>
  );
}

function Rasters() {
  return (
    <Loaded of={useReading<{ rasters: Raster[]; datum: string | null }>("/v1/rasters", 60)}>
      {({ rasters, datum }) => (
        <>
          <Table
            caption={t("admin.rasters.caption")}
            none={t("admin.rasters.none")}
            rows={rasters}
            columns={[
              { title: t("admin.rasters.name"), cell: (one) => <Place name={one.name} box={one.bbox} /> },
              { title: t("admin.rasters.credit"), cell: credit },
              { title: t("admin.rasters.priority"), number: true, cell: (one) => number(one.priority) },
              { title: t("admin.rasters.resolution"), number: true, cell: resolution },
              {
                title: t("admin.rasters.quality"),
                cell: (one) => t(one.with_quality ? "admin.rasters.with" : "admin.rasters.without"),
              },
              { title: t("admin.regions.imported"), cell: (one) => moment(one.imported_at) },
              {
                title: t("admin.failures.acts"),
                cell: (one) => (
                  <button
                    type="button"
                    class="danger"
                    aria-label={t("admin.regions.remove_of", { name: one.name })}
                    onClick={() => void askFor("remove-raster", one.name)}
                  >
                    {t("admin.regions.remove")}
                  </button>
                ),
              },
            ]}
          />
          {datum && <p class="quiet-text">{t("admin.rasters.datum", { datum })}</p>}
        </>
      )}
    </Loaded>
  );
}

/** Files that come in, and what became of them: what a new service needs first. */
export function Imports() {
  return (
    <>
      <div class="cards">
        <div class="card">
          <ImportFile kind="import-roads" />
        </div>
        <div class="card">
          <ImportFile kind="import-dem" />
        </div>
      </div>
      <Operations />
    </>
  );
}

export function MapData() {
  return (
    <>
      <Regions />
      <Rasters />
      <div class="cards">
        <div class="card">
          <h3>{t("admin.settle.title")}</h3>
          <p>{t("admin.settle.what")}</p>
          <button type="button" onClick={() => void settle()}>
            {t("admin.settle.button")}
          </button>
        </div>
      </div>
    </>
  );
}
