/** That the service has no roads yet: asked for once by each page that needs some, and again for as long as it is so. */
import { signal } from "@preact/signals";
import { getJson } from "./api";
import { isNobody, may } from "./session";
import { t } from "./texts";

/** Whether there are no roads; false where nobody knows. */
export const lacksRoads = signal(false);
/** The form that roads are imported by. */
export const IMPORT_FORM = "/admin#import";

const AGAIN_MS = 3000;
let watched = false;

async function look(): Promise<void> {
  // Tiles have bounds wherever there are roads.
  const tiles = await getJson<{ bounds?: unknown }>("/tiles.json").catch(() => null);
  if (tiles !== null) lacksRoads.value = tiles.bounds === undefined;
  watched = lacksRoads.value;
  if (watched) setTimeout(again, AGAIN_MS);
}

function again(): void {
  // A page that nobody sees asks when it is seen.
  if (document.hidden) document.addEventListener("visibilitychange", again, { once: true });
  else void look();
}

/** Look whether there are roads, until there are. */
export function watchRoads(): void {
  if (watched) return;
  watched = true;
  void look();
}

/** What helps: the form for whoever may import, else whom to ask. */
export function RoadsAdvice({ link = "" }: { link?: string }) {
  return may("operate") ? (
    <a class={link} href={IMPORT_FORM}>
      {t("roads.import")}
    </a>
  ) : (
    <span>{t("roads.ask")}</span>
  );
}

/** One line on every page that needs roads. */
export function RoadsNotice() {
  if (!lacksRoads.value || isNobody()) return null;
  return (
    <p class="roads-notice" role="status">
      <span>{t("roads.none")}</span> <RoadsAdvice />
    </p>
  );
}
