/** Proposals of `incline` for OpenStreetMap, for people who look at each of them: a file, and what to do with it. */
import { useEffect, useState } from "preact/hooks";
import { t } from "../../shared/texts";
import { leastDrives } from "../state";
import { Making, mayMake, OnlyWithKey, useMaking } from "./making";
import { clicked } from "./Tools";

const EDITORS = ["josm", "maproulette"] as const;
/** The format's own least number of drives. */
const LEAST_DRIVES = 2;

export default function Inclines() {
  const { make, ...making } = useMaking();
  const [editor, choose] = useState<(typeof EDITORS)[number]>("josm");
  const least = Math.max(LEAST_DRIVES, leastDrives.value);
  const ask = (format: (typeof EDITORS)[number]) => {
    choose(format);
    make({ format, options: { min_drives: least } });
  };
  useEffect(() => {
    if (clicked.now === "inclines" && mayMake()) ask("josm");
    clicked.now = null;
  }, []);
  if (!mayMake()) return <OnlyWithKey />;
  return (
    <>
      <p>{t("tools.inclines.what", { n: least })}</p>
      <div class="buttons panel-actions">
        {EDITORS.map((one) => (
          <button
            key={one}
            type="button"
            aria-pressed={editor === one}
            disabled={making.busy}
            onClick={() => ask(one)}
          >
            {t(`tools.inclines.for_${one}`)}
          </button>
        ))}
      </div>
      <Making {...making} nothing={t("tools.inclines.nothing")} holds="tools.inclines.found" />
      <h3>{t("tools.inclines.then")}</h3>
      <ol class="steps">
        {([1, 2, 3] as const).map((n) => (
          <li key={n}>{t(`tools.inclines.${editor}_${n}`)}</li>
        ))}
      </ol>
      <p class="note">{t("tools.inclines.careful")}</p>
      <p class="quiet-text small">
        <a href="/docs/how-to/feed-routers-and-editors#proposals-of-incline-maproulette-and-josm">
          {t("tools.inclines.more")}
        </a>
      </p>
    </>
  );
}
