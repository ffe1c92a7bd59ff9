/** Who will see what of a drive that is sent. */
import { may, session } from "../shared/session";
import { t } from "../shared/texts";

export function Seen() {
  const now = session();
  if (now === null) return null;
  const seen = now.access === "open" ? "open" : now.public_map;
  return (
    <p class="intro quiet-text">
      {t(`upload.seen.${seen}`, { n: now.public_owners ?? 0 })}{" "}
      {may("own") && <a href="/owner">{t("upload.your_data")}</a>}
    </p>
  );
}
