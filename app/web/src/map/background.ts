/** A style of somebody else below the roads: the addresses are settings (VERSANT_MAP_BACKGROUND_URL, _BACKGROUNDS). */
import type { LayerSpecification, SpriteSpecification, StyleSpecification } from "maplibre-gl";
import { NAMES } from "./style";

const OWN_SIGNS = "versant";
/** Sources and layers of the background begin with it. */
const BELOW = "background:";

/**
 * Both in one. A style has letters from one place only: the background's, but for fonts that the service has
 * (`lettersOf`). Signs of the roads get a prefix. Where the background has letters the service's own names would be there
 * twice, and are left out; pictures of a map have letters, too.
 */
export function over(background: StyleSpecification, roads: StyleSpecification): StyleSpecification {
  const sources = Object.fromEntries(
    Object.entries(background.sources).map(([name, source]) => [BELOW + name, source]),
  );
  const below = background.layers.map(
    (one) =>
      ({
        ...one,
        id: BELOW + one.id,
        ...("source" in one && typeof one.source === "string" ? { source: BELOW + one.source } : {}),
      }) as LayerSpecification,
  );
  const lettered = background.layers.some(
    (one) => one.type === "raster" || (one.type === "symbol" && one.layout?.["text-field"] !== undefined),
  );
  const above = roads.layers
    .filter((one) => one.type !== "background" && !(lettered && one.source === NAMES))
    .map(withOwnSign);
  return {
    ...roads,
    glyphs: background.glyphs ?? roads.glyphs ?? "",
    sprite: [...signs(background.sprite), { id: OWN_SIGNS, url: roads.sprite as string }],
    sources: { ...sources, ...roads.sources },
    layers: [...below, ...above],
  };
}

function signs(sprite: SpriteSpecification | undefined): { id: string; url: string }[] {
  if (sprite === undefined) return [];
  return typeof sprite === "string" ? [{ id: "default", url: sprite }] : sprite;
}

function withOwnSign(one: LayerSpecification): LayerSpecification {
  if (one.type !== "symbol" || typeof one.layout?.["icon-image"] !== "string") return one;
  return { ...one, layout: { ...one.layout, "icon-image": `${OWN_SIGNS}:${one.layout["icon-image"]}` } };
}

/** Where letters of the service's own fonts come from, whatever the style says; null: as the style says. */
export function lettersOf(url: string, own: string | undefined, fonts: ReadonlySet<string>): string | null {
  const asked = /([^/]+)\/(\d+-\d+)\.pbf(?:\?.*)?$/.exec(url);
  if (!asked || !own) return null;
  const [, stack, range] = asked as unknown as [string, string, string];
  if (!fonts.has(decodeURIComponent(stack))) return null;
  return own.replace("{fontstack}", stack).replace("{range}", range);
}
