/** What drives over one segment say of each other's sigmas, and widenings of device classes. */
import { moment, number } from "../../shared/format";
import { t } from "../../shared/texts";
import { widen } from "../actions/operations";
import { queryAddress } from "../links";
import { useQuery } from "../page_state";
import { AsOf, Loaded } from "../parts/Section";
import { Table } from "../parts/Table";
import type { DeviceClass, Repeat } from "../types";

const DIFFERENT = "different classes";
const SIGMAS = 1.96;
const ROW = 26;
const NAMES = 190;
const WIDTH = 620;

function band(row: Repeat): [number, number] {
  const apart = SIGMAS * (row.rms_z_sigma ?? 0);
  return [Math.max(0, row.rms_z - apart), row.rms_z + apart];
}

function zText(row: Repeat): string {
  const [low, high] = band(row);
  return row.rms_z_sigma === null
    ? number(row.rms_z, 2)
    : `${number(row.rms_z, 2)} (${number(low, 2)}–${number(high, 2)})`;
}

/** A dot and its band for each class, beside the line at 1. */
function ZChart({ rows }: { rows: Repeat[] }) {
  const most = Math.min(6, Math.max(2, ...rows.map((row) => band(row)[1])));
  const at = (z: number) => NAMES + (Math.min(z, most) / most) * (WIDTH - NAMES - 12);
  const height = ROW * rows.length + 22;
  const ticks = Array.from({ length: Math.floor(most) + 1 }, (_, k) => k);
  return (
    <figure class="z-chart">
      <figcaption>{t("admin.repeats.chart")}</figcaption>
      <svg viewBox={`0 0 ${WIDTH} ${height}`} aria-hidden="true">
        {ticks.map((z) => (
          <g key={z} class={z === 1 ? "one" : undefined}>
            <line x1={at(z)} x2={at(z)} y1={0} y2={height - 20} />
            <text x={at(z)} y={height - 5} text-anchor="middle">
              {z}
            </text>
          </g>
        ))}
        {rows.map((row, k) => {
          const y = ROW * (k + 0.5);
          const [low, high] = band(row);
          return (
            <g key={row.group} class={low > 1 ? "off" : "dot"}>
              <text x={NAMES - 10} y={y + 4} text-anchor="end">
                {row.group}
              </text>
              <line x1={at(low)} x2={at(high)} y1={y} y2={y} />
              <circle cx={at(row.rms_z)} cy={y} r={5} />
            </g>
          );
        })}
      </svg>
    </figure>
  );
}

function Groups({ rows }: { rows: Repeat[] }) {
  return (
    <Table
      caption={t("admin.repeats.caption")}
      none={t("admin.repeats.none")}
      rows={rows}
      most={40}
      csv={queryAddress("repeats")}
      columns={[
        {
          title: t("admin.repeats.group"),
          cell: (row) =>
            row.kind === "all"
              ? t("admin.repeats.kinds.all")
              : `${t(`admin.repeats.kinds.${row.kind}`)}: ${row.group}`,
        },
        { title: t("admin.repeats.rms"), number: true, cell: zText },
        {
          title: t("admin.repeats.inside"),
          number: true,
          cell: (row) => `${number(100 * row.inside_share, 0)} %`,
        },
        {
          title: t("admin.repeats.difference"),
          number: true,
          cell: (row) => `${number(row.median_difference_percent, 2)} %`,
        },
        {
          title: t("admin.repeats.sigma"),
          number: true,
          cell: (row) => `${number(row.mean_sigma_percent, 2)} %`,
        },
        {
          title: t("admin.repeats.pairs"),
          number: true,
          cell: (row) =>
            t("admin.repeats.pairs_of", { n: number(row.pairs), drives: number(row.drive_pairs) }),
        },
      ]}
    />
  );
}

function Widenings() {
  return (
    <Loaded of={useQuery<DeviceClass>("device-classes", 30)}>
      {(answer) => (
        <Table
          caption={t("admin.repeats.classes")}
          none={t("admin.repeats.no_class")}
          rows={answer.rows}
          most={40}
          csv={queryAddress("device-classes")}
          columns={[
            { title: t("admin.repeats.device"), cell: (row) => row.name },
            {
              title: t("admin.repeats.learned"),
              number: true,
              cell: (row) => `${number(row.learned, 2)} ± ${number(row.sigma, 2)}`,
            },
            { title: t("admin.repeats.applied"), number: true, cell: (row) => number(row.applied, 2) },
            {
              title: t("admin.repeats.pairs"),
              number: true,
              cell: (row) =>
                t("admin.repeats.pairs_of", { n: number(row.pairs), drives: number(row.drive_pairs) }),
            },
            { title: t("admin.repeats.at"), cell: (row) => moment(row.learned_at) },
          ]}
        />
      )}
    </Loaded>
  );
}

export function Repeats() {
  return (
    <>
      <p>{t("admin.repeats.what")}</p>
      <Loaded of={useQuery<Repeat>("repeats", 60)}>
        {(answer) => {
          const classes = answer.rows.filter((row) => row.kind === "class" && row.group !== DIFFERENT);
          return (
            <>
              {classes.length > 0 && <ZChart rows={classes} />}
              <Groups rows={answer.rows} />
              <AsOf answer={answer} />
            </>
          );
        }}
      </Loaded>
      <Widenings />
      <div class="buttons">
        <button type="button" onClick={() => void widen("learn-widenings")}>
          {t("admin.repeats.learn")}
        </button>
        <button type="button" onClick={() => void widen("reset-widenings")}>
          {t("admin.repeats.reset")}
        </button>
      </div>
    </>
  );
}
