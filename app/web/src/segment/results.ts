/** What the service has for what was written: each result says what it is and goes there. */
import { flyTo, showSelected, view } from "../map/state";
import { ApiProblem } from "../shared/api";
import { distance, number } from "../shared/format";
import { t } from "../shared/texts";
import { choose } from "./choosing";
import { boxOf, loadSegment, type Segment, segmentsWhere, type Way, waysOf, wayThrough } from "./data";
import { apart, begins, exactly, fromName, type Meaning } from "./finding";
import { roadClass } from "./words";

export interface Result {
  key: string;
  label: string;
  detail: string;
  go: () => void | Promise<void>;
  /** Written into the field and looked for, instead of gone to. */
  name?: string;
}
export interface Found {
  results: Result[];
  /** Why there is none, or what else is to be known of them. */
  message: string;
}

const MOST_WAYS = 8;
const MOST_NAMES = 6;
const NAMED_AT_ONCE = 50;

function goTo(kind: "segment" | "way", road: Segment | Way): void {
  choose(kind, road.id);
  showSelected(boxOf([road]), road.geometry.coordinates, true);
}

function ofSegment(segment: Segment): Result {
  const of = segment.properties;
  return {
    key: `segment ${segment.id}`,
    label: t("segment.title", { id: String(segment.id) }),
    detail: [of.name ?? t("segment.unnamed"), roadClass(of.highway), distance(of.length_m)].join(" · "),
    go: () => goTo("segment", segment),
  };
}

function ofWay(way: Way): Result {
  const of = way.properties;
  return {
    key: `way ${way.id}`,
    label: t("segment.way_title", { id: String(of.osm_way_id) }),
    detail: [of.name ?? t("segment.unnamed"), roadClass(of.highway), distance(of.length_m)].join(" · "),
    go: () => goTo("way", way),
  };
}

/** Segments of one name as the ways that they are of, the nearest to what is looked at first. */
function byWay(segments: readonly Segment[]): Result[] {
  const ways = new Map<number, Segment[]>();
  for (const one of segments) {
    const { osm_way_id: way } = one.properties;
    ways.set(way, [...(ways.get(way) ?? []), one]);
  }
  const far = (some: readonly Segment[]) =>
    Math.min(
      ...some.flatMap((one) =>
        one.geometry.coordinates.map(([lon, lat]) => apart(view.peek() ?? { lon, lat }, { lon, lat })),
      ),
    );
  return [...ways]
    .map(([osmWay, some]) => ({ osmWay, some, metres: far(some) }))
    .sort((a, b) => a.metres - b.metres)
    .slice(0, MOST_WAYS)
    .map(({ osmWay, some, metres }) => {
      const of = (some[0] as Segment).properties;
      return {
        key: `named ${osmWay}`,
        label: of.name ?? "",
        detail: [
          roadClass(of.highway),
          t("segment.way_title", { id: String(osmWay) }),
          t("segment.away", { far: distance(metres) }),
        ].join(" · "),
        go: async () => {
          const segment = some[0] as Segment;
          const ways = await waysOf(osmWay, new AbortController().signal);
          const way = wayThrough(ways, segment.geometry.coordinates[0] as [number, number]);
          if (way) goTo("way", way);
          else goTo("segment", segment);
        },
      };
    });
}

async function segment(id: number, signal: AbortSignal): Promise<Result[]> {
  try {
    return [ofSegment(await loadSegment(id, signal))];
  } catch (error) {
    if (error instanceof ApiProblem && error.status === 404) return [];
    throw error;
  }
}

/** Several names that begin so: one short look into the index for each. */
async function names(name: string, signal: AbortSignal): Promise<Result[]> {
  const named: Result[] = [];
  let after: string | null = null;
  while (named.length < MOST_NAMES) {
    const [next] = await segmentsWhere(fromName(name, after), 1, signal);
    const called: string | null | undefined = next?.properties.name;
    if (!called || called === after || !begins(called, name)) break;
    named.push({
      key: `name ${called}`,
      label: called,
      detail: t("segment.a_name"),
      go: () => {},
      name: called,
    });
    after = called;
  }
  return named;
}

/** What there is for a meaning. */
export async function find(meant: Meaning, signal: AbortSignal): Promise<Found> {
  const none = (message: string): Found => ({ results: [], message });
  if (meant.kind === "wrong") return none(t(`segment.wrong.${meant.why}`));
  if (meant.kind === "place") {
    const { lon, lat, zoom = 16 } = meant;
    const label = `${number(lat, 5)}°, ${number(lon, 5)}°`;
    const go = () => flyTo({ lon, lat, zoom });
    return { results: [{ key: "place", label, detail: t("segment.a_place"), go }], message: "" };
  }
  if (meant.kind === "name") {
    const segments = await segmentsWhere(exactly(meant.name), NAMED_AT_ONCE, signal);
    const results = [
      ...byWay(segments),
      ...(await names(meant.name, signal)).filter((one) => one.name !== segments[0]?.properties.name),
    ];
    return results.length > 0 ? { results, message: "" } : none(t("segment.no_name", { name: meant.name }));
  }
  const id = String(meant.id);
  const ways = meant.kind === "segment" ? [] : (await waysOf(meant.id, signal)).map(ofWay);
  const segments = meant.kind === "way" ? [] : await segment(meant.id, signal);
  const results = [...ways, ...segments];
  return results.length > 0 ? { results, message: "" } : none(t(`segment.no_${meant.kind}`, { id }));
}
