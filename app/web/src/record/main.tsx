/** Records a drive in a phone's browser, for a try-out: what it cannot do is said first. */
import { errorText } from "../shared/Messages";
import { Page, show } from "../shared/Page";
import { t } from "../shared/texts";
import { items } from "../upload/queue";
import { Row } from "../upload/Row";
import { Seen } from "../upload/Seen";
import { KeptList } from "./KeptList";
import { begin, look, unreadable } from "./kept";
import { Limits } from "./Limits";
import { Running } from "./Running";
import { elsewhere, running, start } from "./recorder";
import "../upload/upload.css";
import "./record.css";

/** Names of this machine that mean another one on a phone. */
const HERE_ONLY = /^(localhost|127\.|\[::1\])/;

/** Browsers give positions to pages over https, and of this machine, alone. */
function Insecure() {
  return (
    <section class="card" role="alert">
      <h2>{t("record.insecure")}</h2>
      <p>{t("record.insecure_why", { address: location.origin })}</p>
      <ul>
        <li>
          {t("record.insecure_https")}{" "}
          <a href="/docs/how-to/put-on-the-internet">{t("record.insecure_how")}</a>
        </li>
        <li>
          {t("record.insecure_else")} <a href="/docs/how-to/record">{t("record.better")}</a>
        </li>
      </ul>
    </section>
  );
}

function Ready() {
  if (elsewhere.value) return <p class="card warn-text">{t("record.elsewhere")}</p>;
  return (
    <>
      {HERE_ONLY.test(location.hostname) && (
        <p class="quiet-text">{t("record.here_only", { host: location.host })}</p>
      )}
      <button type="button" class="primary begin" onClick={() => void start().then(look)}>
        {t("record.start")}
      </button>
      <p class="quiet-text">{t("record.start_what")}</p>
      {unreadable.value !== null && (
        <p class="error-text" role="alert">
          {t("record.unreadable", { why: errorText(unreadable.value) })}
        </p>
      )}
    </>
  );
}

/** What became of those that were sent, and of what this tab uploaded else. */
function Sent() {
  if (items.value.length === 0) return null;
  return (
    <section aria-labelledby="sent">
      <h2 id="sent">{t("record.sent")}</h2>
      <ul class="uploads">
        {items.value.map((item) => (
          <Row key={item.id} item={item} />
        ))}
      </ul>
    </section>
  );
}

function Content() {
  const runs = running.value !== null;
  return (
    <Page name="record">
      <h1>{t("record.title")}</h1>
      {runs ? (
        <Running stopped={look} />
      ) : (
        <>
          <p class="intro">{t("record.what")}</p>
          <KeptList />
          <Sent />
          <Seen />
        </>
      )}
      <Limits />
      {!isSecureContext ? <Insecure /> : !runs && <Ready />}
    </Page>
  );
}

if (isSecureContext) begin();
await show("record", Content);
