/**
 * A drive's report in sentences. Each figure is said by one line here and one text; what nobody says stands in the
 * table of all figures (`allFigures`).
 */
import { distance, duration, number, percent } from "../shared/format";
import { inWords, type Said, term } from "../shared/said";
import { hasText, type TextKey, type TextValues, t } from "../shared/texts";
import type { Report } from "./data";

export const TOPICS = [
  "result",
  "matching",
  "sensors",
  "mount",
  "noise",
  "heights",
  "positions",
  "log",
] as const;
export type Topic = (typeof TOPICS)[number];

type Sayings = Partial<Record<string, { topic: Topic; say: (value: never, report: Report) => string[] }>>;

function percentOf(share: number): string {
  return `${number(100 * share, share > 0.995 && share < 1 ? 1 : 0)} %`;
}

function sentence(key: string, values: TextValues = {}): string {
  return t(`drive.report.${key}` as TextKey, values);
}

/** The name of something that the service names, in the visitor's language where there is one. */
export function nameOf(kind: string, name: string): string {
  const key = `drive.${kind}.${name.replaceAll(" ", "_")}`;
  return hasText(key) ? t(key) : name;
}

/** Sensors and columns that a log lacks, each by what people call it; columns that have no such name by their sensor. */
export function lacking(names: readonly string[]): string[] {
  const said = names.map((name) => {
    const own = nameOf("lacks", name.replaceAll(".", "_"));
    const [sensor = name] = name.split(".");
    return own === name.replaceAll(".", "_") && sensor !== name
      ? sentence("lacks_part", { of: nameOf("lacks", sensor) })
      : own;
  });
  return [...new Set(said)];
}

interface Found {
  value: number;
  sigma: number;
}

function withSigma(one: Found | null | undefined, decimals: number): string {
  return one ? `${number(one.value, decimals)} ± ${number(one.sigma, decimals)}` : sentence("unknown");
}

/** What was set right, that nothing was to be, or that nothing shows it. */
function setRight(key: string, used: number, shown: Found | null, decimals: number): string[] {
  if (!shown) return [sentence(`${key}_unknown`)];
  const values = { [key]: number(used, decimals), found: withSigma(shown, decimals) };
  return [sentence(used === 0 ? `${key}_none` : key, values)];
}

interface Mount {
  pitch_deg: number;
  sigma_deg: number;
  moves: { time_s: number; change_deg: number }[];
}
interface Inertia {
  imu_lag_s: number;
  found_imu_lag_s: Found | null;
  mount_yaw_deg: number;
  found_mount_yaw_deg: Found | null;
}
interface SensorWorth {
  measurements: number;
  outliers: number;
  grade_sigma_percent: number;
  grade_sigma_percent_without: number;
}
interface Gnss {
  positioning?: string;
  epochs?: number;
  solved?: number;
  predicted?: number;
  satellites?: number;
  systems?: string[];
  reflected_share?: number | null;
}

function clock(time_s: number): string {
  return new Date(1000 * time_s).toISOString().slice(11, 19);
}

/** The unit and digits of a level of noise, as its text writes it. */
const LEVELS: Record<string, (value: number) => string> = {
  altitude_m: (value) => number(value, 2),
  drift: (value) => number(Math.sqrt(60 * value), 1),
  doppler: (value) => number(value, 1),
  pitch: (value) => number(100 * value, 2),
  force: (value) => number(100 * value, 2),
  baro_m: (value) => number(value, 2),
  baro_drift: (value) => number(Math.sqrt(60 * value), 1),
  dem_m: (value) => number(value, 1),
};
/** Which sensor a level of noise is of: one that took no part has the level that it started with, which says nothing. */
const OF: Record<string, string> = {
  altitude_m: "altitude",
  drift: "altitude",
  doppler: "doppler",
  pitch: "pitch",
  force: "specific force",
  baro_m: "barometer",
  baro_drift: "barometer",
  dem_m: "dem",
};

function counts(key: string, of: Record<string, number>): string[] {
  return Object.entries(of).map(([reason, n]) => sentence(key, { n, reason: term(reason) }));
}

const SAYINGS: Sayings = {
  segments_estimated: {
    topic: "result",
    say: (n: number, report) => {
      const sigma = report["median_slope_sigma_percent"] as number | null;
      return [
        sigma === null
          ? sentence("segments", { n })
          : sentence("segments_sigma", { n, sigma: number(sigma, sigma < 0.1 ? 2 : 1) }),
      ];
    },
  },
  distance_m: {
    topic: "result",
    say: (metres: number | null, report) =>
      metres === null
        ? []
        : [sentence("length", { length: distance(metres), time: duration(report["duration_s"] as number) })],
  },
  segments_in_network: {
    topic: "result",
    say: (n: number, report) => [
      n > 0 ? sentence("in_network", { n, passes: Number(report["passes"] ?? n) }) : sentence("slopes_only"),
    ],
  },
  rejected_segments: {
    topic: "result",
    say: (n: number) => [n > 0 ? sentence("rejected", { n }) : sentence("none_rejected")],
  },
  matched_share: {
    topic: "matching",
    say: (share: number) => [sentence("matched", { share: percentOf(share) })],
  },
  breaks: {
    topic: "matching",
    say: (breaks: { time_s: number; reason: string }[]) =>
      breaks.length > 12
        ? [sentence("breaks", { n: breaks.length })]
        : breaks.map((one) =>
            sentence("break", { clock: clock(one.time_s), reason: nameOf("reason", one.reason) }),
          ),
  },
  passes_dropped_as_uncertain: {
    topic: "matching",
    say: (n: number) => (n > 0 ? [sentence("dropped", { n })] : []),
  },
  passes_of_part_of_a_segment: {
    topic: "matching",
    say: (n: number) => (n > 0 ? [sentence("in_part", { n })] : []),
  },
  sensors: {
    topic: "sensors",
    say: (sensors: Record<string, SensorWorth>) =>
      Object.entries(sensors)
        .sort(([, a], [, b]) => b.grade_sigma_percent_without - a.grade_sigma_percent_without)
        .map(([name, one]) =>
          sentence(one.outliers > 0 ? "sensor_outliers" : "sensor", {
            name: nameOf("sensor", name),
            n: one.measurements,
            outliers: one.outliers,
            sigma: number(one.grade_sigma_percent, 2),
            without: number(one.grade_sigma_percent_without, 2),
          }),
        ),
  },
  mount: {
    topic: "mount",
    say: (mount: Mount | null) =>
      mount === null
        ? []
        : [
            sentence(mount.pitch_deg < 0 ? "mount_down" : "mount_up", {
              angle: number(Math.abs(mount.pitch_deg), 2),
              sigma: number(mount.sigma_deg, 2),
            }),
            ...mount.moves.map((move) =>
              sentence("mount_moved", { angle: number(move.change_deg, 1), clock: clock(move.time_s) }),
            ),
            ...(mount.moves.length === 0 ? [sentence("mount_firm")] : []),
          ],
  },
  inertia: {
    topic: "mount",
    say: (inertia: Inertia | null) =>
      inertia === null
        ? []
        : [
            ...setRight("lag", inertia.imu_lag_s, inertia.found_imu_lag_s, 3),
            ...setRight("yaw", inertia.mount_yaw_deg, inertia.found_mount_yaw_deg, 1),
          ],
  },
  mount_pitch_deg: {
    topic: "mount",
    say: (angle: number | null, report) =>
      angle === null
        ? []
        : [
            sentence(angle < 0 ? "mount_down" : "mount_up", {
              angle: number(Math.abs(angle), 2),
              sigma: number(report["mount_pitch_sigma_deg"] as number | null, 2),
            }),
          ],
  },
  noise: {
    topic: "noise",
    say: (noise: Record<string, number>, report) => {
      const used = report["sensors"] as Record<string, unknown> | undefined;
      return Object.entries(LEVELS).flatMap(([name, write]) => {
        const value = noise[name];
        return value !== undefined && (!used || (OF[name] ?? "") in used)
          ? [sentence(`noise_${name}`, { value: write(value) })]
          : [];
      });
    },
  },
  speed_pressure: {
    topic: "noise",
    say: (pressure: { share: number; found_share: Found | null } | null) =>
      pressure === null
        ? []
        : [
            sentence("speed_pressure", {
              share: percent(100 * pressure.share, 0),
              found: withSigma(pressure.found_share, 2),
            }),
          ],
  },
  white_altitude_sigma_m: {
    topic: "noise",
    say: (value: number | null) =>
      value === null ? [] : [sentence("noise_altitude_m", { value: number(value, 2) })],
  },
  outage_share: {
    topic: "positions",
    say: (share: number) => [sentence("outages", { share: percentOf(share) })],
  },
  height_datum: {
    topic: "heights",
    say: (datum: string | null) => (datum ? [sentence("datum", { datum: term(datum) })] : []),
  },
  dem: {
    topic: "heights",
    say: (dem: string | null, report) => {
      const share = report["dem_share"] as number | null;
      return dem === null
        ? [sentence("no_dem")]
        : [
            sentence("dem", {
              dem: inWords(dem, report["dem_said"] as Said | null),
              share: share === null ? "–" : percentOf(share),
            }),
          ];
    },
  },
  height_jumps_s: {
    topic: "heights",
    say: (times: number[]) => times.map((at) => sentence("height_jump", { clock: clock(at) })),
  },
  gnss: {
    topic: "positions",
    say: (gnss: Gnss) => {
      if (gnss.solved === undefined)
        return gnss.positioning === "receiver"
          ? [t("drive.positioning.receiver")]
          : gnss.positioning
            ? [t("drive.positioning.of", { name: gnss.positioning })]
            : [];
      return [
        sentence("positions_computed", {
          name: gnss.positioning ?? "",
          n: gnss.solved,
          all: gnss.epochs ?? gnss.solved,
          predicted: gnss.predicted ?? 0,
          satellites: number(gnss.satellites, 0),
          systems: (gnss.systems ?? []).join(", "),
        }),
        ...(typeof gnss.reflected_share === "number"
          ? [sentence("reflected", { share: percentOf(gnss.reflected_share) })]
          : []),
      ];
    },
  },
  format: {
    topic: "log",
    say: (format: string, report) => [sentence("format", { format, n: Number(report["epochs"] ?? 0) })],
  },
  skipped: { topic: "log", say: (of: Record<string, number>) => counts("skipped", of) },
  repaired: { topic: "log", say: (of: Record<string, number>) => counts("repaired", of) },
  missing: {
    topic: "log",
    say: (names: string[]) =>
      names.length > 0
        ? [sentence("missing", { n: lacking(names).length, names: lacking(names).join(", ") })]
        : [],
  },
};

/** What the report says, by topic; topics of which nothing is said are left out. */
export function sentencesOf(report: Report): [Topic, string[]][] {
  const by = new Map<Topic, string[]>(TOPICS.map((topic) => [topic, []]));
  for (const [key, saying] of Object.entries(SAYINGS)) {
    const value = report[key];
    if (!saying || value === undefined) continue;
    try {
      by.get(saying.topic)?.push(...saying.say(value as never, report));
    } catch {
      // A report of another version may hold something else there: the table of all figures shows it as it is.
    }
  }
  return [...by].filter(([, sentences]) => sentences.length > 0);
}

/** Every figure of a report with the way to it, `noise.pitch`, as text. */
export function allFigures(report: Report): [string, string][] {
  const rows: [string, string][] = [];
  const walk = (path: string, value: unknown): void => {
    if (typeof value === "object" && value !== null && !Array.isArray(value) && Object.keys(value).length > 0)
      for (const [key, inner] of Object.entries(value)) walk(path ? `${path}.${key}` : key, inner);
    else rows.push([path, plain(value)]);
  };
  for (const [key, value] of Object.entries(report)) if (!key.startsWith("warnings")) walk(key, value);
  return rows.sort(([a], [b]) => (a < b ? -1 : 1));
}

function plain(value: unknown): string {
  if (typeof value === "number")
    return Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(6)));
  return typeof value === "string" ? value : JSON.stringify(value);
}

/** Versions that a result rests on. */
export function versionsOf(report: Report): string {
  const of = (key: string) => String(report[key] ?? "–");
  return sentence("versions", {
    code: of("code_version"),
    roads: of("road_version"),
    dem: of("dem_version"),
  });
}
