/** Recordings that are on this device alone: to be sent, gone on with, taken as a file, deleted. */
import { useSignal } from "@preact/signals";
import { confirmed } from "../shared/Confirm";
import { distance, moment, number, size } from "../shared/format";
import { tellError } from "../shared/Messages";
import { t } from "../shared/texts";
import { clock } from "./clock";
import type { Recording } from "./keeper";
import { download, forget, isSending, kept, LEAST_POSITIONS, look, send } from "./kept";
import { start } from "./recorder";

function when(recording: Recording): string {
  return moment(new Date(recording.began_ms).toISOString());
}

async function askToDelete(recording: Recording): Promise<void> {
  const { positions, distance_m } = recording.totals;
  const yes = await confirmed({
    title: t("record.delete_title", { when: when(recording) }),
    what: <p>{t("record.delete_what", { n: positions, distance: distance(distance_m) })}</p>,
    action: t("record.delete"),
    destructive: true,
  });
  if (yes) await forget(recording);
}

function Actions({ of: recording }: { of: Recording }) {
  const busy = useSignal(false);
  const press = (work: (recording: Recording) => Promise<void>) => async () => {
    busy.value = true;
    await work(recording).catch(tellError);
    busy.value = false;
  };
  const named = { when: when(recording) };
  const some = recording.totals.positions >= LEAST_POSITIONS;
  return (
    <div class="tools">
      {some && (
        <button
          type="button"
          class="primary"
          disabled={busy.value}
          aria-label={t("record.send_named", named)}
          onClick={press(send)}
        >
          {t("record.send")}
        </button>
      )}
      {!recording.sealed && (
        <button
          type="button"
          aria-label={t("record.go_on_named", named)}
          onClick={() => {
            void start(recording).then(look);
          }}
        >
          {t("record.go_on")}
        </button>
      )}
      {some && (
        <button
          type="button"
          disabled={busy.value}
          aria-label={t("record.download_named", named)}
          onClick={press(download)}
        >
          {t("record.download")}
        </button>
      )}
      <button
        type="button"
        class="danger"
        disabled={busy.value}
        aria-label={t("record.delete_named", named)}
        onClick={press(askToDelete)}
      >
        {t("record.delete")}
      </button>
    </div>
  );
}

function Item({ of: recording }: { of: Recording }) {
  const { positions, distance_m, ran_ms, bytes, gaps, longest_gap_ms, motions } = recording.totals;
  return (
    <li class="card">
      <p>
        <strong>{when(recording)}</strong> {clock(ran_ms)} · {distance(distance_m)} ·{" "}
        {t("record.n_positions", { n: positions })} · {size(bytes)}
      </p>
      {positions < LEAST_POSITIONS && <p class="warn-text">{t("record.nothing")}</p>}
      {gaps > 0 && (
        <p class="warn-text">
          {t("record.gaps_were", { n: gaps, count: number(gaps), longest: clock(longest_gap_ms) })}
        </p>
      )}
      {motions === 0 && positions >= LEAST_POSITIONS && <p class="quiet-text">{t("record.no_motion")}</p>}
      {isSending(recording) ? (
        <p class="quiet-text">{t("record.on_its_way")}</p>
      ) : (
        <>
          {recording.sealed && <p class="quiet-text">{t("record.sealed")}</p>}
          <Actions of={recording} />
        </>
      )}
    </li>
  );
}

export function KeptList() {
  const all = kept.value;
  if (all === null || all.length === 0) return null;
  return (
    <section aria-labelledby="kept">
      <h2 id="kept">{t("record.kept")}</h2>
      <p class="quiet-text">{t("record.kept_what")}</p>
      <ul class="recordings">
        {all.map((one) => (
          <Item key={one.id} of={one} />
        ))}
      </ul>
    </section>
  );
}
