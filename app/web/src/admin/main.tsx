/** The operators' page: what needs a person, then what happens, then what there is and what can be done to it. */
import type { ComponentType } from "preact";
import { Page, show } from "../shared/Page";
import { may } from "../shared/session";
import { currentLanguage, t } from "../shared/texts";
import type texts from "../texts/en.json";
import { chooseDays, DAYS, days, listProblem, offers, reader, ready } from "./page_state";
import { Section } from "./parts/Section";
import { USUAL_S } from "./reading";
import { Agreement } from "./sections/Agreement";
import { Attention } from "./sections/Attention";
import { Audit } from "./sections/Audit";
import { Bulk } from "./sections/Bulk";
import { Coverage } from "./sections/Coverage";
import { Failures } from "./sections/Failures";
import { Imports, MapData } from "./sections/MapData";
import { Queue } from "./sections/Queue";
import { Repeats } from "./sections/Repeats";
import { Room } from "./sections/Room";
import { Terrain } from "./sections/Terrain";
import { Throughput } from "./sections/Throughput";
import "./admin.css";

interface Part {
  id: keyof typeof texts.admin.parts;
  /** The query without which there is nothing to be shown. */
  query?: string;
  /** Whether it is open at first. */
  open: boolean;
  Content: ComponentType;
}

// What is open at first is cheap; the rest is read when somebody opens it.
const PARTS: Part[] = [
  { id: "attention", query: "attention", open: true, Content: Attention },
  { id: "import", open: true, Content: Imports },
  { id: "queue", query: "queue", open: true, Content: Queue },
  { id: "failures", query: "failures", open: true, Content: Failures },
  { id: "throughput", query: "drives", open: true, Content: Throughput },
  { id: "coverage", query: "coverage", open: false, Content: Coverage },
  { id: "agreement", query: "disagreements", open: false, Content: Agreement },
  { id: "repeats", query: "repeats", open: false, Content: Repeats },
  { id: "terrain", query: "terrain", open: false, Content: Terrain },
  { id: "roads", open: false, Content: MapData },
  { id: "bulk", open: false, Content: Bulk },
  { id: "room", query: "storage", open: false, Content: Room },
  { id: "audit", query: "audit", open: false, Content: Audit },
];

/** When it was read last, whether it is read again, and the choice of days. */
function Reading() {
  const at = reader.readAt.value;
  const rests = reader.restsUntil.value;
  const time = (ms: number) => new Date(ms).toLocaleTimeString(currentLanguage());
  return (
    <div class="reading">
      <p>
        {at === null ? t("admin.read.first") : t("admin.read.at", { at: time(at) })}{" "}
        {rests !== null ? (
          <span class="warn-text" role="status">
            {t("admin.read.rests", { at: time(rests) })}
          </span>
        ) : (
          t(reader.paused.value ? "admin.read.paused" : "admin.read.again", { s: USUAL_S })
        )}
      </p>
      <label>
        {t("admin.days.label")}{" "}
        <select value={days.value} onChange={(event) => chooseDays(Number(event.currentTarget.value))}>
          {DAYS.map((one) => (
            <option key={one} value={one}>
              {t("admin.days.last", { n: one })}
            </option>
          ))}
        </select>
      </label>
      <button type="button" onClick={() => reader.readNow()}>
        {t("admin.read.now")}
      </button>
      <button
        type="button"
        aria-pressed={reader.paused.value}
        onClick={() => {
          reader.paused.value = !reader.paused.value;
        }}
      >
        {t("admin.read.pause")}
      </button>
    </div>
  );
}

function Content() {
  const parts = PARTS.filter((one) => offers(one.query));
  return (
    <Page name="admin">
      <h1>{t("page.admin")}</h1>
      <Reading />
      {listProblem.value !== null && <p class="error-text">{listProblem.value}</p>}
      {ready.value && (
        <>
          <nav class="parts" aria-label={t("admin.navigation")}>
            <ul>
              {parts.map(({ id }) => (
                <li key={id}>
                  <a href={`#${id}`}>{t(`admin.parts.${id}`)}</a>
                </li>
              ))}
            </ul>
          </nav>
          {parts.map(({ id, open, Content: Inside }) => (
            <Section key={id} id={id} title={t(`admin.parts.${id}`)} open={open} Content={Inside} />
          ))}
        </>
      )}
    </Page>
  );
}

await show("admin", Content);
if (may("operate")) reader.start();
