/** A way: its slope by length, where it is steepest, how much of it was measured, and its segments. */
import { useEffect, useState } from "preact/hooks";
import { flyTo, showSelected } from "../map/state";
import { distance, moment, number, slope } from "../shared/format";
import { errorText } from "../shared/Messages";
import { t } from "../shared/texts";
import { choose } from "./choosing";
import { boxOf, loadSegmentsOf, loadWay, middleOf, pointedPlace, type Segment, type Way } from "./data";
import { useLoaded } from "./loading";
import { Road, Sources } from "./Road";
import { Facts } from "./SegmentView";
import { besideModel, compass, headline, share, steepest } from "./words";

export function WayView({ id }: { id: number }) {
  const way = useLoaded((signal) => loadWay(id, signal), id);
  return (
    <>
      <p role="status" class="unseen">
        {way.state === "there" ? t("segment.way_shown", { id: String(id) }) : t("segment.asking")}
      </p>
      {way.state === "asking" && <h2>{t("segment.asking")}</h2>}
      {way.state === "failed" && (
        <>
          <h2>{t("segment.way_title", { id: String(id) })}</h2>
          <p class="error-text" role="alert">
            {way.why}
          </p>
        </>
      )}
      {way.state === "there" && <Shown way={way.value} />}
    </>
  );
}

function Shown({ way }: { way: Way }) {
  const of = way.properties;
  useEffect(() => showSelected(boxOf([way]), way.geometry.coordinates), [way]);
  const [from, to] = [way.geometry.coordinates[0], way.geometry.coordinates.at(-1)];
  if (!from || !to) return null;
  const unknown = of.slope_percent === null;
  return (
    <>
      <Road road={of} title={t("segment.way_title", { id: String(of.osm_way_id) })} />
      <p class={unknown ? "headline unknown" : "headline"}>
        {headline(of.slope_percent, of.slope_sigma_percent, compass(from, to))}
      </p>
      <p class={unknown ? "note" : "quiet-text small"}>
        {t(unknown ? "segment.way_undriven" : "segment.way_mean")}
      </p>
      <Facts
        rows={[
          [
            t("segment.steepest"),
            steepest(of.steepest_percent, of.steepest_from_m, of.steepest_to_m, of.length_m),
          ],
          [t("segment.measured_share"), share(of.measured_share)],
          [t("segment.fewest_drives"), of.drives === 0 ? t("segment.no_drives") : number(of.drives)],
          [t("segment.model"), besideModel(of.slope_percent, of.dem_slope_percent, true)],
          [t("segment.changed"), of.updated_at === null ? t("segment.never") : moment(of.updated_at)],
        ]}
      />
      <p class="quiet-text small">{t("segment.way_convention")}</p>
      <div class="buttons panel-actions">
        <button type="button" onClick={() => flyTo({ bbox: boxOf([way]) })}>
          {t("segment.fly")}
        </button>
      </div>
      <Segments way={way} />
      <Sources
        osmWay={of.osm_way_id}
        place={from}
        address={`/collections/ways/items/${way.id}`}
        copied={way}
      />
    </>
  );
}

interface Read {
  segments: Segment[];
  next: string | null;
  asking: boolean;
  why: string | null;
}

function Segments({ way }: { way: Way }) {
  const [read, set] = useState<Read>({ segments: [], next: null, asking: true, why: null });
  const [wanted, want] = useState<string | null>(null);
  const { osm_way_id, segments: all } = way.properties;
  useEffect(() => {
    const ended = new AbortController();
    set((before) => ({ ...before, asking: true, why: null }));
    loadSegmentsOf(osm_way_id, wanted, ended.signal).then(
      (page) =>
        set((before) => ({
          segments: [...(wanted === null ? [] : before.segments), ...page.segments],
          next: page.next,
          asking: false,
          why: null,
        })),
      (error) => {
        if (!ended.signal.aborted) set((before) => ({ ...before, asking: false, why: errorText(error) }));
      },
    );
    return () => {
      ended.abort();
      pointedPlace.value = null;
    };
  }, [osm_way_id, wanted]);
  const point = (one: Segment | null) => () => {
    pointedPlace.value = one && middleOf(one);
  };
  return (
    <>
      <h3>{t("segment.segments")}</h3>
      <p class="quiet-text small" role="status">
        {read.asking
          ? t("segment.asking")
          : t("segment.segments_listed", {
              n: read.segments.length,
              all: Math.max(all, read.segments.length),
            })}
      </p>
      {read.why !== null && <p class="error-text">{read.why}</p>}
      <ol class="segments">
        {read.segments.map((one) => (
          <li key={one.id}>
            <button
              type="button"
              class="quiet"
              onMouseEnter={point(one)}
              onMouseLeave={point(null)}
              onFocus={point(one)}
              onBlur={point(null)}
              onClick={() => {
                choose("segment", one.id);
              }}
            >
              <span>{t("segment.title", { id: String(one.id) })}</span>
              <span class="number">{distance(one.properties.length_m)}</span>
              <span class="number">{summaryOf(one)}</span>
            </button>
          </li>
        ))}
      </ol>
      {read.next !== null && (
        <button type="button" disabled={read.asking} onClick={() => want(read.next)}>
          {t("segment.more_segments")}
        </button>
      )}
    </>
  );
}

/** What is known of a segment of the list, and from where. */
function summaryOf({ properties: of }: Segment): string {
  if (of.slope_percent === null) return t("segment.list_unknown");
  const value = slope(of.slope_percent, of.slope_sigma_percent);
  return of.drives === 0 ? t("segment.list_gap", { slope: value }) : value;
}
