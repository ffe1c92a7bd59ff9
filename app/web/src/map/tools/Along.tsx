/** What the service says of the roads along a line, as charts and in figures. */
import { useEffect, useMemo } from "preact/hooks";
import type { components } from "../../api/schema";
import { pointedPlace } from "../../segment/data";
import { useLoaded } from "../../segment/loading";
import { Facts } from "../../segment/SegmentView";
import { datumText, share } from "../../segment/words";
import { api, got } from "../../shared/api";
import { Chart, chartLink, type Line } from "../../shared/Chart";
import { creditLine } from "../../shared/credit";
import { distance, number } from "../../shared/format";
import { t } from "../../shared/texts";
import type { Position } from "../state";
import { lengthOf } from "./length";
import { encoded } from "./polyline";

type Heights = components["schemas"]["Heights"];
const MEASURED = "measured";
/** Places along the line that are asked for, and how near they may be, metres. */
const PLACES = 1500;
const LEAST_STEP_M = 5;

function ask(points: readonly Position[], signal: AbortSignal): Promise<Heights> {
  const body = {
    encoded_polyline: encoded(points),
    shape_format: "polyline5",
    range: true,
    slope: true,
    resample_distance: Math.max(LEAST_STEP_M, lengthOf(points) / PLACES),
  } as components["schemas"]["HeightRequest"];
  // Pairs come as lists of any length there.
  return got(api.POST("/height", { body, signal })) as Promise<unknown> as Promise<Heights>;
}

export function Along({ points }: { points: readonly Position[] }) {
  const heights = useLoaded((signal) => ask(points, signal), points);
  if (heights.state === "failed")
    return (
      <p class="error-text" role="alert">
        {heights.why}
      </p>
    );
  return heights.state === "there" ? (
    <Shown heights={heights.value} />
  ) : (
    <p role="status">{t("segment.asking")}</p>
  );
}

function Shown({ heights }: { heights: Heights }) {
  const link = useMemo(chartLink, []);
  const along = useMemo(() => (heights.range_height ?? []).map(([metres]) => metres as number), [heights]);
  const height = useMemo(() => heightLines(heights), [heights]);
  const slope = useMemo(() => slopeLines(heights), [heights]);
  useEffect(
    () => () => {
      pointedPlace.value = null;
    },
    [],
  );
  const { climb } = heights;
  const point = (at: number | null) => {
    const place = at === null ? undefined : heights.shape?.[along.indexOf(at)];
    pointedPlace.value = place ? { lon: place.lon, lat: place.lat } : null;
  };
  const doubt = (value: number, sigma: number) =>
    `${number(value)} ± ${number(sigma, sigma < 9.5 ? 1 : 0)} m`;
  if (!climb || climb.known_share === 0) return <p class="note">{t("tools.profile.no_roads")}</p>;
  return (
    <>
      <Facts
        rows={[
          [t("tools.profile.length"), distance(along.at(-1) ?? 0)],
          [t("tools.profile.ascent"), doubt(climb.ascent_m, climb.ascent_sigma_m)],
          [t("tools.profile.descent"), doubt(climb.descent_m, climb.descent_sigma_m)],
          [t("tools.profile.measured"), share(climb.measured_share)],
          ...(climb.known_share < 0.995
            ? ([[t("tools.profile.unknown"), share(1 - climb.known_share)]] as [string, string][])
            : []),
        ]}
      />
      <Chart
        title={t("tools.profile.heights")}
        axis="distance"
        unit="m"
        x={along}
        lines={height}
        height={170}
        link={link}
        onHover={point}
      />
      <Chart
        title={t("tools.profile.slopes")}
        axis="distance"
        unit="%"
        x={along}
        lines={slope}
        height={170}
        link={link}
        onHover={point}
      />
      <p class="quiet-text small">{t("tools.profile.note")}</p>
      <p class="quiet-text small">{datumText(heights.datum)}</p>
      <p class="quiet-text small">{creditLine(heights.attribution)}</p>
    </>
  );
}

type Values = (number | null)[];

/** What was measured and what was not are lines of their own: between them lies a step of their datums. */
function parted(heights: Heights, values: Values, sigma: Values, unit: string): Line[] {
  const only = (measured: boolean, some: Values) =>
    some.map((one, n) => ((heights.source[n] === MEASURED) === measured ? one : null));
  const lines: Line[] = [
    {
      label: t("segment.line_measured"),
      values: only(true, values),
      sigma: only(true, sigma),
      colour: "measured",
      unit,
    },
    {
      label: t("segment.line_model"),
      values: only(false, values),
      sigma: only(false, sigma),
      colour: "model",
      dashed: true,
      unit,
    },
  ];
  return lines.filter((one) => (one.values as Values).some((value) => value !== null));
}

const heightLines = (of: Heights) =>
  parted(
    of,
    (of.range_height ?? []).map(([, height]) => height as number | null),
    of.sigma,
    "m",
  );

const slopeLines = (of: Heights) => parted(of, of.slope_percent ?? [], of.slope_sigma_percent ?? [], "%");
