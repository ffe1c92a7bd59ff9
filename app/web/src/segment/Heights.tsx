/** The heights along a segment, measured and by the elevation model. */
import { useMemo } from "preact/hooks";
import { Chart, type Line, type Stretch } from "../shared/Chart";
import { t } from "../shared/texts";
import { type Profile, pointedPlace, type Segment } from "./data";

/** A band much wider than the road is high would leave of its course a flat line. */
function bandFits(profile: Profile): boolean {
  const heights = [...profile.height_m, ...profile.dem_height_m].filter((one) => one !== null);
  const sigma = Math.max(...profile.height_sigma_m.map((one) => one ?? 0));
  return sigma <= 3 * Math.max(Math.max(...heights) - Math.min(...heights), 2);
}

export function Heights({ segment, profile }: { segment: Segment; profile: Profile }) {
  const of = segment.properties;
  const measured = profile.source !== null;
  const model = profile.dem_height_m.some((one) => one !== null);
  const drawable = bandFits(profile);
  const lines = useMemo(() => {
    const all: Line[] = [];
    if (measured)
      all.push({
        label: t(profile.source === "neighbours" ? "segment.line_gap" : "segment.line_measured"),
        values: profile.height_m,
        ...(drawable ? { sigma: profile.height_sigma_m } : {}),
        colour: "measured",
        unit: "m",
      });
    if (model)
      all.push({
        label: t("segment.line_model"),
        values: profile.dem_height_m,
        colour: "model",
        dashed: true,
        unit: "m",
      });
    return all;
  }, [profile]);
  const stretches = useMemo((): Stretch[] => {
    const { steepest_from_m: from, steepest_to_m: to } = of;
    return measured && from !== null && to !== null ? [{ from, to, colour: "measured" }] : [];
  }, [segment, profile]);
  if (lines.length === 0) return <p class="note">{t("segment.no_heights")}</p>;
  const [start, end] = [segment.geometry.coordinates[0], segment.geometry.coordinates.at(-1)];
  const point = (along: number | null) => {
    if (along === null || !start || !end) pointedPlace.value = null;
    else {
      const at = along / profile.length_m;
      pointedPlace.value = {
        lon: start[0] + at * (end[0] - start[0]),
        lat: start[1] + at * (end[1] - start[1]),
      };
    }
  };
  return (
    <>
      <Chart
        title={t("segment.profile")}
        axis="distance"
        unit="m"
        x={profile.along_m}
        lines={lines}
        stretches={stretches}
        height={180}
        onHover={point}
      />
      <p class="quiet-text small">
        {t(
          !measured
            ? "segment.profile_model_only"
            : drawable
              ? "segment.profile_note"
              : "segment.profile_no_band",
        )}
        {of.bridge || of.tunnel ? ` ${t("segment.profile_structure")}` : ""}
      </p>
    </>
  );
}
