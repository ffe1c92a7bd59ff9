/** The devices that send, with the last point of each. */
import { confirmed } from "../shared/Confirm";
import { duration, number, UNKNOWN } from "../shared/format";
import { tellDone, tellError } from "../shared/Messages";
import { t } from "../shared/texts";
import { revoke, type Stream, senders, streams } from "./state";

const titleOf = (stream: Stream) =>
  senders.value.find((one) => one.name === stream.sender)?.title ?? stream.sender;

function seen(stream: Stream): string {
  const time = stream.seen_ago_s < 60 ? `${number(stream.seen_ago_s)} s` : duration(stream.seen_ago_s);
  if (stream.last === null) return t("phones.ago_only", { time });
  const place = `${number(stream.last.lat, 4)}, ${number(stream.last.lon, 4)}`;
  return t("phones.ago", { time, place });
}

async function askToRevoke(stream: Stream): Promise<void> {
  const label = stream.label ?? "";
  const question = {
    title: t("phones.revoke_title", { label }),
    what: <p>{t("phones.revoke_what")}</p>,
    action: t("phones.revoke"),
    destructive: true,
  };
  if (!(await confirmed(question))) return;
  try {
    await revoke(stream);
    tellDone(t("phones.is_revoked", { label }));
  } catch (error) {
    tellError(error);
  }
}

function State({ of: stream }: { of: Stream }) {
  return (
    <span>
      {stream.revoked ? t("phones.revoked") : stream.under_way ? t("phones.under_way") : t("phones.closed")}
      {": "}
      {stream.drive === null ? (
        t("phones.no_drive")
      ) : (
        <a href={`/drives/${stream.drive}`}>{t("phones.drive")}</a>
      )}
      {stream.unusable > 0 && (
        <small class="warn-text">
          {t("phones.unusable", { n: stream.unusable, why: stream.unusable_why ?? "" })}
        </small>
      )}
    </span>
  );
}

function Row({ of: stream }: { of: Stream }) {
  const label = stream.label ?? (stream.device || titleOf(stream));
  return (
    <tr>
      <th scope="row">
        {label}
        {stream.device !== "" && stream.device !== label && <small> {stream.device}</small>}
      </th>
      <td data-label={t("phones.program")}>{titleOf(stream)}</td>
      <td data-label={t("phones.last")}>{seen(stream)}</td>
      <td data-label={t("phones.state")}>
        <State of={stream} />
      </td>
      <td class="actions">
        {stream.key === null || stream.revoked ? (
          UNKNOWN
        ) : (
          <button
            type="button"
            class="danger"
            aria-label={t("phones.revoke_named", { label })}
            onClick={() => void askToRevoke(stream)}
          >
            {t("phones.revoke")}
          </button>
        )}
      </td>
    </tr>
  );
}

export function Devices() {
  const all = streams.value;
  if (all === null) return null;
  return (
    <section aria-labelledby="devices">
      <h2 id="devices">{t("phones.devices")}</h2>
      {all.length === 0 ? (
        <p class="card">{t("phones.none")}</p>
      ) : (
        // biome-ignore lint/a11y/noNoninteractiveTabindex: what scrolls is reached by keyboard
        <div class="wide" tabIndex={0}>
          <table class="devices stacked">
            <thead>
              <tr>
                <th scope="col">{t("phones.device")}</th>
                <th scope="col">{t("phones.program")}</th>
                <th scope="col">{t("phones.last")}</th>
                <th scope="col">{t("phones.state")}</th>
                <th scope="col">{t("phones.actions")}</th>
              </tr>
            </thead>
            <tbody>
              {all.map((one) => (
                <Row key={`${one.key} ${one.sender} ${one.device}`} of={one} />
              ))}
            </tbody>
          </table>
        </div>
      )}
    </section>
  );
}
