/** A file of what the map shows: asked for, followed, and handed over. */
import { useEffect, useRef, useState } from "preact/hooks";
import type { components } from "../../api/schema";
import { api, got } from "../../shared/api";
import { moment, size } from "../../shared/format";
import { LogIn } from "../../shared/LoggedIn";
import { errorText } from "../../shared/Messages";
import { reasonOf } from "../../shared/remarks";
import { inWords, loadSaid } from "../../shared/said";
import { may } from "../../shared/session";
import { t } from "../../shared/texts";
import { wholeBox } from "../free";
import { shownMap } from "../shown";

export type Export = components["schemas"]["Export"];
export type Wish = Partial<components["schemas"]["ExportRequest"]> & { format: string };
const ASK_EVERY_MS = 700;

const fileOf = (one: Export) => `/v1/exports/${one.id}/file`;

/** Browsers take an answer with a name of its own as a file, and stay on the page. */
function download(one: Export): void {
  const link = document.createElement("a");
  link.href = fileOf(one);
  link.download = one.file_name;
  link.click();
}

/** The export as it stands; `make` asks for one of the view. */
export function useMaking(): { made: Export | null; why: string; busy: boolean; make: (wish: Wish) => void } {
  const [made, set] = useState<Export | null>(null);
  const [why, fail] = useState("");
  const [asked, ask] = useState<{ wish: Wish } | null>(null);
  useEffect(() => {
    if (asked === null) return;
    const ended = new AbortController();
    const { signal } = ended;
    const follow = async () => {
      const map = shownMap.peek();
      if (!map) return;
      const body = { bbox: wholeBox(map), ...asked.wish } as components["schemas"]["ExportRequest"];
      let one = await got(api.POST("/v1/exports", { body, signal }));
      await loadSaid();
      while (!signal.aborted) {
        set(one);
        if (one.status !== "queued" && one.status !== "running") break;
        await new Promise((wake) => setTimeout(wake, ASK_EVERY_MS));
        const path = { export_id: one.id };
        one = await got(api.GET("/v1/exports/{export_id}", { params: { path }, signal }));
      }
      if (one.status === "done" && !signal.aborted && one.entries !== 0) download(one);
    };
    set(null);
    fail("");
    follow().catch((error) => {
      if (!signal.aborted) fail(errorText(error));
    });
    return () => ended.abort();
  }, [asked]);
  const busy =
    asked !== null && why === "" && (made === null || made.status === "queued" || made.status === "running");
  return { made, why, busy, make: (wish) => ask({ wish }) };
}

/** How far it is, why there is none, or the file. */
export function Making({
  made,
  why,
  busy,
  nothing,
  holds = "tools.making.entries",
}: {
  made: Export | null;
  why: string;
  busy: boolean;
  nothing: string;
  /** Says how many of what the file holds. */
  holds?: "tools.making.entries" | "tools.inclines.found";
}) {
  const failed =
    why ||
    ((made?.failure ? reasonOf(made.failure) : null) ??
      (made?.status === "cancelled" ? t("tools.making.cancelled") : ""));
  const place = useRef<HTMLDivElement>(null);
  // A phone's sheet ends above it.
  useEffect(() => {
    if (busy || made) place.current?.scrollIntoView({ block: "nearest" });
  }, [busy, made?.status]);
  return (
    <div class="making" ref={place}>
      <p role={failed ? "alert" : "status"} class={failed ? "error-text" : ""}>
        {failed ||
          (busy
            ? made?.status === "running"
              ? t("tools.making.running", { n: Math.round(100 * made.progress) })
              : t("tools.making.queued")
            : made && (made.entries === 0 ? nothing : t("tools.making.done")))}
      </p>
      {busy && <progress max={1} value={made?.progress ?? 0} aria-label={t("tools.making.progress")} />}
      {made?.status === "done" && made.entries !== 0 && (
        <>
          <p>
            <a class="button primary" href={fileOf(made)} download={made.file_name}>
              {t("tools.making.file", { name: made.file_name })}
            </a>
          </p>
          <p class="quiet-text small">
            {size(made.size_bytes)} · {t(holds, { n: made.entries ?? 0 })} ·{" "}
            {t("tools.making.kept", { moment: moment(made.expires_at) })}
          </p>
          {made.notes.map((one, n) => (
            <p key={one} class="quiet-text small">
              {inWords(one, made.notes_said?.[n])}
            </p>
          ))}
        </>
      )}
    </div>
  );
}

/** Files are made for whoever has a key: what is said in their place. */
export function OnlyWithKey() {
  return (
    <p class="note">
      {t("tools.making.log_in_why")} <LogIn text={t("page.log_in")} />
    </p>
  );
}

export const mayMake = () => may("own");
