/** A map's credit names the elevation data that lies under what it shows, not all that the service has. */
import type { Map as LibreMap, VectorTileSource } from "maplibre-gl";
import { getJson } from "./api";
import { t } from "./texts";

/** Whose elevation data lies where: boxes of degrees, west, south, east, north. */
interface Elevation {
  credit: string;
  boxes: [number, number, number, number][];
}
/** The control of the map's credit reads it there. */
type Credited = VectorTileSource & { attribution?: string };
interface Tiles {
  attribution?: string;
  "versant:elevation"?: Elevation[];
}

/** Credits of data under a box. */
export function creditsIn(all: readonly Elevation[], box: readonly number[]): string[] {
  const [west = 0, south = 0, east = 0, north = 0] = box;
  return all
    .filter(({ boxes }) => boxes.some(([w, s, e, n]) => w <= east && west <= e && s <= north && south <= n))
    .map(({ credit }) => credit);
}

const escaped = (text: string) => text.replace(/[&<>"]/g, (one) => `&#${one.charCodeAt(0)};`);

/** Whose the roads are, in the visitor's language. */
const inOwnWords = (credit: string) =>
  credit.replace("© OpenStreetMap contributors", t("map.osm_contributors"));

/** The line of plain text that a document has, in the visitor's language. */
export function creditLine(attribution: string): string {
  const [whose = "", elevation] = attribution.split("; elevation from ");
  const roads = whose.replace("Roads © OpenStreetMap contributors", t("map.roads_by"));
  return elevation === undefined ? roads : t("map.credit_line", { roads, elevation });
}

/** The service's own attribution with these credits of elevation in the place of all. */
export function withCredits(attribution: string, credits: readonly string[]): string {
  const [roads = "", elevation] = inOwnWords(attribution).split(/(?<=<\/a>), elevation from /);
  if (elevation === undefined || credits.length === 0) return roads;
  return t("map.credit", { roads, elevation: credits.map(escaped).join(", ") });
}

/** Let the credit of a source of the service's tiles follow what is in view. */
export function creditInView(map: LibreMap, name: string): void {
  let tiles: Tiles | null = null;
  const change = (id: string, said: (credit: string) => string) => {
    const source: Credited | undefined = map.getSource<VectorTileSource>(id);
    if (!source?.attribution || source.attribution === said(source.attribution)) return;
    source.attribution = said(source.attribution);
    map.fire("sourcedata", { dataType: "source", sourceDataType: "metadata", source, sourceId: id });
  };
  const tell = () => {
    const of = tiles;
    let said: string | undefined;
    if (of?.attribution) {
      const view = map.getBounds();
      const box = [view.getWest(), view.getSouth(), view.getEast(), view.getNorth()];
      said = withCredits(of.attribution, creditsIn(of["versant:elevation"] ?? [], box));
    }
    // What is said by another source as well stands there once.
    for (const id of Object.keys(map.getStyle().sources)) {
      change(id, (credit) => (id === name && said !== undefined ? said : inOwnWords(credit)));
    }
  };
  // From a source's first word on, and again where another style brings it anew.
  map.on("sourcedata", (event) => event.sourceDataType === "metadata" && tell());
  map.once("idle", () => {
    getJson<Tiles>("/tiles.json")
      .then((document) => {
        tiles = document;
        tell();
        map.on("moveend", tell);
      })
      .catch(() => undefined); // the whole credit stays
  });
}
