/** One segment: its slope in words, where it is steepest, how sure that is, its heights, and the drives behind it. */
import type { ComponentChildren } from "preact";
import { useEffect } from "preact/hooks";
import { flyTo, showSelected } from "../map/state";
import { creditLine } from "../shared/credit";
import { distance, moment, number, slope } from "../shared/format";
import { tellDone, tellError } from "../shared/Messages";
import { may } from "../shared/session";
import { t } from "../shared/texts";
import { choose } from "./choosing";
import { Drives, DrivesAfterLogin } from "./Drives";
import {
  boxOf,
  loadProfile,
  loadSegment,
  type Profile,
  type Segment,
  segmentAddress,
  waysOf,
  wayThrough,
} from "./data";
import { Heights } from "./Heights";
import { useLoaded } from "./loading";
import { Road, Sources } from "./Road";
import { besideModel, compass, datumText, headline, share, steepest } from "./words";

/** Terms and what is said of each. */
export function Facts({ rows }: { rows: [string, ComponentChildren][] }) {
  return (
    <dl class="facts">
      {rows.map(([term, description]) => (
        <div key={term}>
          <dt>{term}</dt>
          <dd>{description}</dd>
        </div>
      ))}
    </dl>
  );
}

async function chooseWay(segment: Segment): Promise<void> {
  try {
    const place = segment.geometry.coordinates[0];
    const ways = await waysOf(segment.properties.osm_way_id, new AbortController().signal);
    const way = place && wayThrough(ways, place);
    if (way) choose("way", way.id);
    else tellDone(t("segment.no_way_yet"));
  } catch (error) {
    tellError(error);
  }
}

export function SegmentView({ id }: { id: number }) {
  const segment = useLoaded((signal) => loadSegment(id, signal), id);
  const profile = useLoaded((signal) => loadProfile(id, signal), id);
  return (
    <>
      <p role="status" class="unseen">
        {segment.state === "there" ? t("segment.shown", { id: String(id) }) : t("segment.asking")}
      </p>
      {segment.state === "asking" && <h2>{t("segment.asking")}</h2>}
      {segment.state === "failed" && (
        <>
          <h2>{t("segment.title", { id: String(id) })}</h2>
          <p class="error-text" role="alert">
            {segment.why}
          </p>
        </>
      )}
      {segment.state === "there" && (
        <Shown segment={segment.value} profile={profile.state === "there" ? profile.value : null}>
          {profile.state === "failed" ? (
            <p class="error-text">{profile.why}</p>
          ) : profile.state === "there" ? (
            <Heights segment={segment.value} profile={profile.value} />
          ) : (
            <p class="quiet-text">{t("segment.asking")}</p>
          )}
        </Shown>
      )}
    </>
  );
}

interface ShownProps {
  segment: Segment;
  profile: Profile | null;
  children: ComponentChildren;
}

function Shown({ segment, profile, children }: ShownProps) {
  const of = segment.properties;
  useEffect(() => showSelected(boxOf([segment]), segment.geometry.coordinates), [segment]);
  const [from, to] = [segment.geometry.coordinates[0], segment.geometry.coordinates.at(-1)];
  if (!from || !to) return null;
  const towards = compass(from, to);
  const gap = of.drives === 0 && of.slope_percent !== null;
  const unknown = of.slope_percent === null;
  const meters = (value: number | null) =>
    value === null ? t("segment.not_known") : `${number(value, 1)} m`;
  return (
    <>
      <Road road={of} title={t("segment.title", { id: String(segment.id) })} />
      <p class={unknown ? "headline unknown" : "headline"}>
        {headline(of.slope_percent, of.slope_sigma_percent, towards)}
      </p>
      {gap && <p class="note">{t("segment.gap")}</p>}
      {unknown && <p class="note">{t("segment.undriven")}</p>}
      <Facts
        rows={[
          [
            t("segment.steepest"),
            steepest(of.steepest_percent, of.steepest_from_m, of.steepest_to_m, of.length_m),
          ],
          [t("segment.model"), besideModel(of.slope_percent, of.dem_slope_percent, of.drives > 0)],
        ]}
      />
      <p class="quiet-text small">
        {t("segment.convention", { from: String(of.from_node), to: String(of.to_node) })}
      </p>
      {children}
      <h3>{t("segment.heights")}</h3>
      <Facts
        rows={[
          [t("segment.height_a"), meters(of.height_from_m)],
          [t("segment.height_b"), meters(of.height_to_m)],
          [
            t("segment.height_sigma"),
            of.height_sigma_m === null ? t("segment.not_known") : `± ${number(of.height_sigma_m, 1)} m`,
          ],
        ]}
      />
      {profile && <p class="quiet-text small">{datumText(profile.datum)}</p>}
      <h3>{t("segment.sure")}</h3>
      <Facts
        rows={[
          [
            t("segment.sigma"),
            unknown
              ? t("segment.not_known")
              : t("segment.sigma_is", { slope: slope(of.slope_percent, of.slope_sigma_percent) }),
          ],
          [t("segment.drives"), of.drives === 0 ? t("segment.no_drives") : number(of.drives)],
          [
            t("segment.observations"),
            of.drives === 0 ? t("segment.no_observations") : number(of.observations),
          ],
          [
            t("segment.driven_share"),
            of.driven_share === null ? t("segment.not_known") : share(of.driven_share),
          ],
          [t("segment.changed"), of.updated_at === null ? t("segment.never") : moment(of.updated_at)],
        ]}
      />
      {of.drives > 0 && (may("own") ? <Drives segment={segment} /> : <DrivesAfterLogin />)}
      <div class="buttons panel-actions">
        <button type="button" onClick={() => chooseWay(segment)}>
          {t("segment.whole_way")}
        </button>
        <button type="button" onClick={() => flyTo({ bbox: boxOf([segment]) })}>
          {t("segment.fly")}
        </button>
      </div>
      <Sources
        osmWay={of.osm_way_id}
        place={from}
        address={segmentAddress(segment.id)}
        copied={{ segment, profile }}
      />
      <p class="quiet-text small">
        {t("segment.length_is", { length: distance(of.length_m) })}{" "}
        {profile && creditLine(profile.attribution)}
      </p>
    </>
  );
}
