/** The map stays as new as the service's: what changed is fetched anew, once it is in view. */
import type { Map as MapLibre } from "maplibre-gl";
import { follow } from "../shared/events";
import { changes } from "./shown";
import { type Box, layer, view } from "./state";
import { SOURCE } from "./style";
import { keyOf, shows, type Tile, tilesOver } from "./tiles";

interface Change {
  version: string;
  bbox: Box | null;
}

const TOGETHER_MS = 150;
/** Ways are put together a moment after their segments, and nobody tells when. */
const WAYS_AFTER_MS = [1500, 5000];
const AGAIN_MS = 20_000;
const MOST_CHANGES = 200;

/** Of tiles, whether they are as new as the last change that was announced. */
export class Freshness {
  private changes: { number: number; box: Box | null }[] = [];
  private readonly fetched = new Map<string, number>();
  private last = 0;

  /** Something changed there. */
  changed(box: Box | null): void {
    this.last += 1;
    this.changes.push({ number: this.last, box });
    if (this.changes.length > MOST_CHANGES) this.changes = [{ number: this.last, box: null }];
  }

  /** Whether anything ever changed: what the browser keeps may be old. */
  get any(): boolean {
    return this.last > 0;
  }

  /** The tile is being fetched. */
  asked(tile: Tile): void {
    this.fetched.set(keyOf(tile), this.last);
  }

  /** Those that were fetched before something in them changed. */
  old(tiles: Tile[]): Tile[] {
    return tiles.filter((tile) => {
      const number = this.fetched.get(keyOf(tile)) ?? 0;
      return this.changes.some((one) => one.number > number && shows(tile, one.box));
    });
  }
}

/** The tiles that the map shows. */
export function tilesInView(map: MapLibre, least: number, most: number): Tile[] {
  const bounds = map.getBounds();
  const z = Math.min(most, Math.floor(map.getZoom()));
  if (z < least) return [];
  return tilesOver([bounds.getWest(), bounds.getSouth(), bounds.getEast(), bounds.getNorth()], z);
}

/** Follow the map's changes for as long as the page is open; `told` gets each box. */
export function stayNew(
  map: MapLibre,
  freshness: Freshness,
  inView: () => Tile[],
  onStale: (tiles: Tile[]) => void,
): void {
  let version: string | null = null;
  let timer = 0;
  const refresh = () => {
    const old = freshness.old(inView());
    if (!old.length || !map.getSource(SOURCE)) return;
    onStale(old);
    map.refreshTiles(SOURCE, old);
    changes.value += 1;
    for (const tile of old) freshness.asked(tile);
  };
  const changed = (box: Box | null) => {
    freshness.changed(box);
    clearTimeout(timer);
    timer = window.setTimeout(refresh, TOGETHER_MS);
  };
  const onChange = (change: Change) => {
    const before = version;
    version = change.version;
    if (before === null || before === change.version) return;
    changed(change.bbox);
    if (layer.value === "ways")
      for (const wait of WAYS_AFTER_MS) window.setTimeout(() => changed(change.bbox), wait);
  };
  const start = () => {
    const end = follow<Change>("/v1/changes/events", "change", onChange, () => {
      end();
      window.setTimeout(start, AGAIN_MS);
    });
  };
  start();
  view.subscribe(refresh);
}
