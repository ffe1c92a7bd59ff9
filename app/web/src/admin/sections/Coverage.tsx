/** How much of the roads was driven: growing over time, by region, by class. */
import { useState } from "preact/hooks";
import { number } from "../../shared/format";
import { t } from "../../shared/texts";
import { queryAddress, roadsOf } from "../links";
import { days, offers, useQuery } from "../page_state";
import { AsOf, Loaded } from "../parts/Section";
import { Table } from "../parts/Table";
import { growthSeries, TimeChart } from "../parts/TimeChart";
import type { Growth, Coverage as Row } from "../types";

export interface RegionSum {
  region: string;
  network_km: number;
  driven_km: number;
  segments: number;
  driven_segments: number;
}

/** Rows of classes added up by region, the longest network first. */
export function byRegion(rows: Row[]): RegionSum[] {
  const sums = new Map<string, RegionSum>();
  for (const row of rows) {
    const sum = sums.get(row.region) ?? {
      region: row.region,
      network_km: 0,
      driven_km: 0,
      segments: 0,
      driven_segments: 0,
    };
    sum.network_km += row.network_km;
    sum.driven_km += row.driven_km;
    sum.segments += row.segments;
    sum.driven_segments += row.driven_segments;
    sums.set(row.region, sum);
  }
  return [...sums.values()].sort((a, b) => b.network_km - a.network_km);
}

function regionName(name: string): string {
  return name || t("admin.coverage.no_region");
}

function Share({ row }: { row: RegionSum | Row }) {
  const share = row.network_km > 0 ? row.driven_km / row.network_km : 0;
  return (
    <span class="share">
      <span class="bar" aria-hidden="true">
        <span style={{ width: `${100 * share}%` }} />
      </span>
      {number(100 * share, share < 0.0995 ? 1 : 0)} %
    </span>
  );
}

const KM = (value: number) => number(value, value < 100 ? 1 : 0);

function Tables({ rows }: { rows: Row[] }) {
  const regions = byRegion(rows);
  const [asked, choose] = useState<string | null>(null);
  const chosen = regions.find((one) => one.region === asked) ?? regions[0];
  const shared = [
    { title: t("admin.coverage.network"), number: true, cell: (row: RegionSum | Row) => KM(row.network_km) },
    { title: t("admin.coverage.driven"), number: true, cell: (row: RegionSum | Row) => KM(row.driven_km) },
    {
      title: t("admin.coverage.share"),
      number: true,
      cell: (row: RegionSum | Row) => <Share row={row} />,
    },
  ];
  if (!chosen) return <p class="quiet-text">{t("admin.coverage.none")}</p>;
  return (
    <>
      <Table
        caption={t("admin.coverage.by_region")}
        rows={regions}
        csv={queryAddress("coverage")}
        columns={[
          {
            title: t("admin.coverage.region"),
            cell: (row) => (row.region ? <a href="#roads">{row.region}</a> : regionName(row.region)),
          },
          ...shared,
          {
            title: t("admin.coverage.segments"),
            number: true,
            cell: (row) => `${number(row.driven_segments)} / ${number(row.segments)}`,
          },
        ]}
      />
      {regions.length > 1 && (
        <label class="choice">
          {t("admin.coverage.choose")}
          <select value={chosen.region} onChange={(event) => choose(event.currentTarget.value)}>
            {regions.map((one) => (
              <option key={one.region} value={one.region}>
                {regionName(one.region)}
              </option>
            ))}
          </select>
        </label>
      )}
      <Table
        caption={t("admin.coverage.by_class", { region: regionName(chosen.region) })}
        rows={rows.filter((row) => row.region === chosen.region)}
        csv={queryAddress("coverage")}
        columns={[
          {
            title: t("admin.coverage.highway"),
            cell: (row) => (
              <a href={roadsOf(row.highway, false)} lang="en">
                {row.highway}
              </a>
            ),
          },
          ...shared,
          {
            title: t("admin.coverage.segments"),
            number: true,
            cell: (row) => (
              <>
                <a
                  href={roadsOf(row.highway, true)}
                  aria-label={t("admin.coverage.driven_of", { n: row.driven_segments, highway: row.highway })}
                >
                  {number(row.driven_segments)}
                </a>{" "}
                / {number(row.segments)}
              </>
            ),
          },
        ]}
      />
    </>
  );
}

function GrowthChart() {
  return (
    <Loaded of={useQuery<Growth>("growth", 300, days.value)}>
      {({ rows }) => (
        <>
          <TimeChart
            {...growthSeries(rows)}
            title={t("admin.coverage.growth")}
            unit="km"
            daily
            csv={queryAddress("growth", { days: days.value, f: "csv" })}
          />
        </>
      )}
    </Loaded>
  );
}

export function Coverage() {
  return (
    <>
      {offers("growth") && <GrowthChart />}
      <Loaded of={useQuery<Row>("coverage", 60)}>
        {(answer) => (
          <>
            <Tables rows={answer.rows} />
            <AsOf answer={answer} />
          </>
        )}
      </Loaded>
    </>
  );
}
