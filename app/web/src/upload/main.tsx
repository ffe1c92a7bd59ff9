import { useEffect, useState } from "preact/hooks";
import { size } from "../shared/format";
import { Page, show } from "../shared/Page";
import { t } from "../shared/texts";
import { Adding } from "./Adding";
import { items, overall, removeDone, retryAll } from "./queue";
import { Row } from "./Row";
import { begin } from "./reload";
import { Seen } from "./Seen";
import "./upload.css";

const TOLD_EVERY_MS = 3000;

/** Says to screen readers how far all is, and not at each step of it. */
function Told({ text }: { text: string }) {
  const [announced, setAnnounced] = useState(text);
  useEffect(() => {
    const timer = setTimeout(() => setAnnounced(text), TOLD_EVERY_MS);
    return () => clearTimeout(timer);
  }, [text]);
  return (
    <p class="unseen" role="status">
      {announced}
    </p>
  );
}

function Overall() {
  const { count, over, done, bad, again, roads, bytes, sent, transferring } = overall.value;
  useEffect(() => {
    if (!transferring) return;
    const asks = (event: BeforeUnloadEvent) => event.preventDefault();
    addEventListener("beforeunload", asks);
    return () => removeEventListener("beforeunload", asks);
  }, [transferring]);
  const counts = [
    t("upload.overall", { n: count, done }),
    ...(roads > 0 ? [t("upload.overall_roads", { n: roads })] : []),
    ...(bad > 0 ? [t("upload.overall_bad", { n: bad })] : []),
  ].join(" ");
  return (
    <section class="overall" aria-labelledby="overall">
      <h2 id="overall">{t("upload.yours")}</h2>
      <p>
        {counts}{" "}
        {transferring ? (
          <span class="quiet-text">
            {t("upload.overall_sent", { sent: size(sent), all: size(bytes) })} {t("upload.stay")}
          </span>
        ) : (
          over < count && <span class="quiet-text">{t("upload.may_leave")}</span>
        )}
      </p>
      <Told text={counts} />
      {transferring && <progress max={bytes || 1} value={sent} aria-label={t("upload.overall_label")} />}
      <div class="tools">
        {again > 1 && (
          <button type="button" onClick={() => void retryAll()}>
            {t("upload.again_all", { n: again })}
          </button>
        )}
        {done > 0 && count > 1 && (
          <button type="button" onClick={removeDone}>
            {t("upload.forget_done")}
          </button>
        )}
        {done > 0 && (
          <a class="button" href="/drives">
            {t("upload.all_drives")}
          </a>
        )}
      </div>
    </section>
  );
}

function Content() {
  return (
    <Page name="upload">
      <h1>{t("upload.title")}</h1>
      <p class="intro">{t("upload.intro")}</p>
      <p class="intro">
        <a href="/phones">{t("upload.by_phone")}</a> {t("upload.or")}{" "}
        <a href="/record">{t("upload.by_browser")}</a>
      </p>
      <Seen />
      <Adding />
      {items.value.length > 0 && (
        <>
          <Overall />
          <ul class="uploads">
            {items.value.map((item) => (
              <Row key={item.id} item={item} />
            ))}
          </ul>
        </>
      )}
    </Page>
  );
}

begin();
await show("upload", Content);
