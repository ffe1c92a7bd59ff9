/** What was done over time and what it took; drives by day; times by method. */
import { dayText, distance, duration, number } from "../../shared/format";
import { hasText, t } from "../../shared/texts";
import { drivesPage, queryAddress } from "../links";
import { days, offers, useQuery } from "../page_state";
import { Loaded } from "../parts/Section";
import { Table } from "../parts/Table";
import { HOURLY_DAYS, stageSeries, TimeChart, throughputSeries } from "../parts/TimeChart";
import type { DayOfDrives, Throughput as Row, Times } from "../types";

function Charts() {
  const csv = queryAddress("throughput", { days: days.value, f: "csv" });
  const daily = days.value > HOURLY_DAYS;
  return (
    <Loaded of={useQuery<Row>("throughput", 60, days.value)}>
      {({ rows }) => (
        <div class="charts">
          <div>
            <TimeChart
              {...throughputSeries(rows, days.value)}
              title={t("admin.throughput.drives")}
              unit=""
              csv={csv}
              daily={daily}
            />
          </div>
          <div>
            <TimeChart
              {...stageSeries(rows)}
              title={t("admin.throughput.stages")}
              unit="s"
              csv={csv}
              daily={daily}
            />
          </div>
        </div>
      )}
    </Loaded>
  );
}

function statusText(status: string): string {
  const key = `admin.status.${status}`;
  return hasText(key) ? t(key) : status;
}

/** The moments that a day of UTC begins and ends with, as the list of drives is asked for it. */
function dayOf(day: string): { created_after: string; created_before: string } {
  const next = new Date(Date.parse(`${day}T00:00:00Z`) + 86_400_000).toISOString().slice(0, 10);
  return { created_after: `${day}T00:00:00Z`, created_before: `${next}T00:00:00Z` };
}

const WAITING = "roads";

/** Drives that failed, and those among them that wait for roads, which are no failures to people. */
function apart(row: DayOfDrives): DayOfDrives[] {
  const waiting = row.waiting ?? 0;
  const others = { ...row, drives: row.drives - waiting };
  if (waiting === 0) return [row];
  return [...(others.drives > 0 ? [others] : []), { ...row, status: WAITING, drives: waiting }];
}

function listed(row: DayOfDrives): { status?: string; waits_for?: string | null } {
  if (row.status === WAITING) return { waits_for: "roads" };
  return { status: row.status, waits_for: row.waiting ? "nothing" : null };
}

function ByDay() {
  return (
    <Loaded of={useQuery<DayOfDrives>("drives", 60, days.value)}>
      {({ rows }) => (
        <Table
          caption={t("admin.throughput.by_day")}
          none={t("admin.throughput.none")}
          rows={rows.flatMap(apart)}
          csv={queryAddress("drives", { days: days.value, f: "csv" })}
          most={10}
          columns={[
            { title: t("admin.throughput.day"), cell: (row) => dayText(row.day) },
            { title: t("admin.throughput.status"), cell: (row) => statusText(row.status) },
            {
              title: t("admin.throughput.count"),
              number: true,
              cell: (row) => (
                <a href={drivesPage({ ...listed(row), ...dayOf(row.day) })}>{number(row.drives)}</a>
              ),
            },
            { title: t("admin.throughput.km"), number: true, cell: (row) => distance(row.km * 1000) },
          ]}
        />
      )}
    </Loaded>
  );
}

function ByMethod() {
  const pair = (half: number | null, most: number | null) => `${duration(half)} / ${duration(most)}`;
  return (
    <Loaded of={useQuery<Times>("times", 60)}>
      {({ rows }) => (
        <Table
          caption={t("admin.times.caption")}
          none={t("admin.times.none")}
          rows={rows}
          csv={queryAddress("times")}
          columns={[
            { title: t("admin.times.method"), cell: (row) => row.method },
            {
              title: t("admin.times.drives"),
              number: true,
              cell: (row) => <a href={drivesPage({ status: "done" })}>{number(row.drives)}</a>,
            },
            {
              title: t("admin.times.waited"),
              number: true,
              cell: (row) => pair(row.waited_p50_s, row.waited_p95_s),
            },
            {
              title: t("admin.times.computed"),
              number: true,
              cell: (row) => pair(row.computed_p50_s, row.computed_p95_s),
            },
            {
              title: t("admin.times.published"),
              number: true,
              cell: (row) => pair(row.published_p50_s, row.published_p95_s),
            },
            {
              title: t("admin.times.per_km"),
              number: true,
              cell: (row) => duration(row.computed_p50_s_per_km),
            },
          ]}
        />
      )}
    </Loaded>
  );
}

export function Throughput() {
  return (
    <>
      {offers("throughput") && <Charts />}
      <ByDay />
      <ByMethod />
    </>
  );
}
