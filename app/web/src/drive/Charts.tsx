/** Height and grade over the distance driven: the estimate with its sigmas before what sensors said. */
import { useComputed } from "@preact/signals";
import { useMemo } from "preact/hooks";
import { Chart, type Line } from "../shared/Chart";
import { t } from "../shared/texts";
import { alignedByRoad, alignedByTime } from "./align";
import type { Profile } from "./data";
import { chosen, marked } from "./ride";
import { combinedColumn, otherLine, sensorLines, stretchesOf } from "./series";
import { hasResult, kinds, link, other, segmentById, sensors } from "./state";

function useLines(profile: Profile): [Line[], Line[]] {
  const against = useComputed(() => {
    const one = other.value;
    if (!one) return null;
    const align = one.kind === "trial" ? alignedByTime : alignedByRoad;
    return { name: one.name, aligned: align(profile, one.profile) };
  }).value;
  const dots = sensors.value;
  const graded = hasResult.value;
  const roads = segmentById.value;
  return useMemo(() => {
    const height: Line[] = [
      ...sensorLines(profile, dots, true),
      ...(graded
        ? [
            {
              label: t("drive.chart.model"),
              values: profile.dem_height_m,
              colour: "model" as const,
              unit: "m",
              dashed: true,
            },
          ]
        : []),
      {
        label: t(graded ? "drive.chart.height" : "drive.chart.log_height"),
        values: profile.alt_m,
        sigma: profile.alt_sigma_m,
        colour: "measured",
        unit: "m",
      },
    ];
    const grade: Line[] = [
      ...sensorLines(profile, dots, false),
      {
        label: t("drive.chart.combined"),
        values: combinedColumn(profile, roads),
        colour: "quiet",
        unit: "%",
        dashed: true,
        hidden: true,
      },
      {
        label: t("drive.chart.grade"),
        values: profile.grade_percent,
        sigma: profile.grade_sigma_percent,
        colour: "measured",
        unit: "%",
      },
    ];
    if (against) {
      height.push(otherLine(profile, against.aligned, against.name, true));
      grade.push(otherLine(profile, against.aligned, against.name, false));
    }
    return [height, grade];
  }, [profile, dots, roads, against, graded]);
}

export function Charts({ profile }: { profile: Profile }) {
  const [height, grade] = useLines(profile);
  const what = kinds.value;
  const looked = chosen.value;
  const stretches = useMemo(
    () => [...stretchesOf(profile, what), ...marked(profile, looked)],
    [profile, what, looked],
  );
  const shared = { axis: "distance" as const, x: profile.distance_m, stretches, link };
  return (
    <section class="card drive-charts" aria-labelledby="charts">
      <h2 id="charts">{t("drive.chart.title")}</h2>
      <p class="quiet-text">{t(hasResult.value ? "drive.chart.how" : "drive.chart.how_log")}</p>
      <Chart {...shared} title={t("drive.chart.heights")} lines={height} unit="m" height={220} />
      {hasResult.value && (
        <Chart {...shared} title={t("drive.chart.grades")} lines={grade} unit="%" height={220} />
      )}
    </section>
  );
}
