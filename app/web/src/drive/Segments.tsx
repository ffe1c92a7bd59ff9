/** Where the drive contradicts others: there it is rejected. */
import { useSignal } from "@preact/signals";
import { mapOf } from "../shared/drives";
import { number, slope } from "../shared/format";
import { tellError } from "../shared/Messages";
import { t } from "../shared/texts";
import type { DriveSegment } from "./data";
import { drawFullProfile } from "./load";
import { Scrolled } from "./Scrolled";
import { link, profile, rejected, segments, wantedBounds } from "./state";
import { stays } from "./stretches";
import { boundsOf } from "./trackLayers";

const SHOWN = 12;
/** What is shown to either side of a segment, in lengths of it. */
const AROUND = 2;

/** A segment's name as people know it. */
export function segmentName(segment: DriveSegment): string {
  return segment.properties.name ?? t("drive.segments.unnamed", { id: segment.id });
}

/** West, south, east and north of a segment. */
function boxOf(segment: DriveSegment): [number, number, number, number] {
  const lon = segment.geometry.coordinates.map(([x]) => x);
  const lat = segment.geometry.coordinates.map(([, y]) => y);
  return [Math.min(...lon), Math.min(...lat), Math.max(...lon), Math.max(...lat)];
}

/** The service's map at a segment. */
function mapOfSegment(segment: DriveSegment): string {
  return `${mapOf(boxOf(segment))}&segment=${segment.id}`;
}

/** Show a segment on the page's own map and charts. */
export async function showSegment(segment: DriveSegment): Promise<void> {
  wantedBounds.value = boxOf(segment);
  const find = () =>
    profile.peek() && stays(profile.peek() as never).find((one) => one.segment === segment.id);
  let stay = find();
  if (!stay) {
    // A short one may have no row among those of a thinned profile.
    await drawFullProfile().catch(tellError);
    stay = find();
  }
  const along = profile.peek()?.distance_m;
  if (!stay || !along) return;
  const spare = AROUND * Math.max(stay.to_m - stay.from_m, 25);
  link.range.value = [
    Math.max(along[0] as number, stay.from_m - spare),
    Math.min(along[along.length - 1] as number, stay.to_m + spare),
  ];
  link.at.value = along[stay.first] as number;
  wantedBounds.value = boundsOf(profile.peek() as never, stay.first, stay.last);
  document.getElementById("charts")?.scrollIntoView({ block: "nearest" });
}

export function Contradictions() {
  const all = useSignal(false);
  const contradicting = segments.value.filter((one) => rejected.value.has(one.id));
  const shown = all.value ? contradicting : contradicting.slice(0, SHOWN);
  return (
    <section class="card" aria-labelledby="contradictions">
      <h2 id="contradictions">{t("drive.segments.title")}</h2>
      {contradicting.length === 0 ? (
        <p class="quiet-text">{t("drive.segments.none")}</p>
      ) : (
        <>
          <p>{t("drive.segments.what", { n: contradicting.length, all: segments.value.length })}</p>
          <Scrolled name={t("drive.segments.title")}>
            <table>
              <thead>
                <tr>
                  <th scope="col">{t("drive.segments.road")}</th>
                  <th scope="col" class="number">
                    {t("drive.segments.this")}
                  </th>
                  <th scope="col" class="number">
                    {t("drive.segments.combined")}
                  </th>
                  <th scope="col" class="number">
                    {t("drive.segments.drives")}
                  </th>
                  <th scope="col">{t("drive.segments.show")}</th>
                </tr>
              </thead>
              <tbody>
                {shown.map((one) => (
                  <tr key={one.id}>
                    <th scope="row">{segmentName(one)}</th>
                    <td class="number">
                      {slope(one.properties.slope_percent, one.properties.slope_sigma_percent)}
                    </td>
                    <td class="number">
                      {slope(
                        one.properties.combined_slope_percent,
                        one.properties.combined_slope_sigma_percent,
                      )}
                    </td>
                    <td class="number">{number(one.properties.combined_drives)}</td>
                    <td>
                      <button type="button" class="quiet" onClick={() => void showSegment(one)}>
                        {t("drive.segments.here")}
                      </button>{" "}
                      <a
                        href={mapOfSegment(one)}
                        aria-label={t("drive.segments.on_map_of", { name: segmentName(one) })}
                      >
                        {t("drive.segments.on_map")}
                      </a>
                    </td>
                  </tr>
                ))}
              </tbody>
            </table>
          </Scrolled>
          {contradicting.length > shown.length && (
            <button type="button" onClick={() => (all.value = true)}>
              {t("drive.segments.more", { n: contradicting.length - shown.length })}
            </button>
          )}
        </>
      )}
    </section>
  );
}
