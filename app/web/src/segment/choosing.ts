/** Choosing on the map what the panel or the search name: segments and ways are drawn by different layers. */
import { kept } from "../map/shown";
import { colour, layer, ofSegmentsOnly, selected } from "../map/state";

export function choose(kind: "segment" | "way", id: number): void {
  // A kept map has segments alone; what is chosen is told all the same.
  if (kept.value === null) {
    layer.value = kind === "way" ? "ways" : "segments";
    if (kind === "way" && ofSegmentsOnly(colour.value)) colour.value = "steepness";
  }
  selected.value = { kind, id };
}
