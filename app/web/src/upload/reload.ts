/** What a reload of this tab leaves of the list: the uploads that became drives. Files that were not sent are gone. */
import { effect } from "@preact/signals";
import { whenTold } from "../shared/tabs";
import { Item, items, type Kept, look } from "./queue";

const KEPT = "versant:uploads";

/** Once, by the page. */
export function begin(): void {
  const kept = JSON.parse(sessionStorage.getItem(KEPT) ?? "[]") as Kept[];
  items.value = kept.map((one) => new Item([], new URLSearchParams(), "", one));
  void look();
  effect(keep);
  whenTold(() => void look());
}

function keep(): void {
  const drives = items.value.filter((item) => item.phase.value !== "cancelled" && item.driveId !== "");
  const kept = drives.map(
    ({ name, size, driveId, known, leftOut }): Kept => ({
      name,
      size,
      driveId,
      known: known.value,
      leftOut: leftOut.value,
    }),
  );
  sessionStorage.setItem(KEPT, JSON.stringify(kept));
}
