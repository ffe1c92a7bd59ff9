/** Where files are added: dropped anywhere on the page, or chosen; and what is asked about those that look like one drive. */
import { signal } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import { tellDone, tellError } from "../shared/Messages";
import { MethodForm } from "../shared/MethodForm";
import { chosenQuery, type MethodChosen, type Methods, USUAL, usable } from "../shared/methods";
import { t } from "../shared/texts";
import { inRuns, isArchive, listFor, listIn } from "./archives";
import { belongTogether, chosenFiles, droppedFiles, type Gathered } from "./gathering";
import { add, addArchive } from "./queue";
import { filesIn, type Packed } from "./zip";

const MOST_OF_A_DRIVE = 32;
const NAMED = 6;

const chosen = signal<MethodChosen>(USUAL);
const known = signal<Methods | null>(null);
const together = signal(false);
/** Of archives what was recorded as another sport than driving and cycling is left out. */
const roadsOnly = signal(true);
/** Files of which nobody has said yet whether they are one drive. */
const asked = signal<File[] | null>(null);

/** `one`: somebody said that the files of each are one drive; else the service looks. */
function begin(drives: File[][], one = false): void {
  const query = chosenQuery(chosen.value, known.value);
  if (one) query.set("grouping", "one");
  const count = add(drives, query);
  if (count === 0) tellDone(t("upload.there_already"));
}

function take({ files, hidden }: Gathered): void {
  if (hidden > 0) tellDone(t("upload.hidden", { n: hidden }));
  if (files.length === 0) {
    if (hidden === 0) tellDone(t("upload.nothing"));
    return;
  }
  if (together.value && files.length > MOST_OF_A_DRIVE) {
    tellError(new Error(t("upload.too_many", { n: files.length, most: MOST_OF_A_DRIVE })));
    return;
  }
  if (together.value) begin([files], true);
  else if (
    belongTogether(
      files.map((file) => file.name),
      MOST_OF_A_DRIVE,
    )
  )
    asked.value = files;
  else void takeEach(files);
}

/** Each file by itself, but a zip of many rides as the files in it. */
async function takeEach(files: File[]): Promise<void> {
  const alone: File[] = [];
  for (const file of files) {
    const inside = /\.zip$/i.test(file.name) ? await filesIn(file).catch((): Packed[] => []) : [];
    if (isArchive(inside, file.name)) await beginArchive(file.name, inside);
    else alone.push(file);
  }
  if (alone.length > 0) begin(alone.map((file) => [file]));
}

async function beginArchive(name: string, inside: Packed[]): Promise<void> {
  const query = chosenQuery(chosen.value, known.value);
  if (roadsOnly.value) query.set("sports", "roads");
  const { runs, others } = inRuns(inside);
  const list = await listIn(inside);
  const count = addArchive(name, runs, others, query, (run) =>
    list ? listFor(run as Packed[], list) : null,
  );
  if (count === 0) tellDone(t("upload.there_already"));
}

function Question({ files }: { files: File[] }) {
  const first = useRef<HTMLButtonElement>(null);
  useEffect(() => first.current?.focus(), []);
  const answer = (drives: File[][]) => {
    asked.value = null;
    if (drives.length > 0) begin(drives, drives.length === 1);
  };
  return (
    <section class="card question" aria-labelledby="one-drive">
      <h2 id="one-drive">{t("upload.one_drive_title", { n: files.length })}</h2>
      <p>{t("upload.one_drive_why")}</p>
      <ul>
        {files.slice(0, NAMED).map((file) => (
          <li key={file.webkitRelativePath || file.name}>{file.name}</li>
        ))}
        {files.length > NAMED && <li>{t("upload.and_more", { n: files.length - NAMED })}</li>}
      </ul>
      <div class="buttons">
        <button type="button" onClick={() => answer([])}>
          {t("page.cancel")}
        </button>
        <button type="button" onClick={() => answer(files.map((file) => [file]))}>
          {t("upload.each_by_itself")}
        </button>
        <button type="button" class="primary" ref={first} onClick={() => answer([files])}>
          {t("upload.one_drive")}
        </button>
      </div>
    </section>
  );
}

function useDrops(): boolean {
  const [over, setOver] = useState(false);
  useEffect(() => {
    const leaves = (event: DragEvent) => {
      if (event.relatedTarget === null) setOver(false);
    };
    const hovers = (event: DragEvent) => {
      if (!event.dataTransfer?.types.includes("Files")) return;
      event.preventDefault();
      setOver(true);
    };
    const drops = (event: DragEvent) => {
      if (!event.dataTransfer?.types.includes("Files")) return;
      event.preventDefault();
      setOver(false);
      droppedFiles(event.dataTransfer).then(take, () => tellError(new Error(t("upload.unreadable"))));
    };
    addEventListener("dragover", hovers);
    addEventListener("dragleave", leaves);
    addEventListener("drop", drops);
    return () => {
      removeEventListener("dragover", hovers);
      removeEventListener("dragleave", leaves);
      removeEventListener("drop", drops);
    };
  }, []);
  return over;
}

function Chooser({ label, folder, primary }: { label: string; folder: boolean; primary: boolean }) {
  const field = useRef<HTMLInputElement>(null);
  return (
    <>
      <button type="button" class={primary ? "primary" : ""} onClick={() => field.current?.click()}>
        {label}
      </button>
      <input
        ref={field}
        type="file"
        hidden
        multiple
        {...(folder ? { webkitdirectory: true } : {})}
        onChange={(event) => {
          take(chosenFiles(event.currentTarget.files ?? []));
          event.currentTarget.value = "";
        }}
      />
    </>
  );
}

/** The part of the page. */
export function Adding() {
  const over = useDrops();
  const changed = chosenQuery(chosen.value, known.value).size > 0;
  const fits = usable(chosen.value, known.value);
  return (
    <>
      <section class={`drop${over ? " over" : ""}`} aria-label={t("upload.add")}>
        <p class="invitation">{t("upload.drop_here")}</p>
        <div class="choose">
          <Chooser label={t("upload.choose_files")} folder={false} primary />
          <Chooser label={t("upload.choose_folder")} folder primary={false} />
        </div>
        <p class="quiet-text">{t("upload.kinds")}</p>
        <label class="check">
          <input
            type="checkbox"
            checked={together.value}
            onChange={(event) => {
              together.value = event.currentTarget.checked;
            }}
          />
          <span>{t("upload.together")}</span>
        </label>
        <label class="check">
          <input
            type="checkbox"
            checked={roadsOnly.value}
            onChange={(event) => {
              roadsOnly.value = event.currentTarget.checked;
            }}
          />
          <span>{t("upload.roads_only")}</span>
        </label>
      </section>
      {asked.value !== null && <Question files={asked.value} />}
      <Method changed={changed} fits={fits} />
    </>
  );
}

function Method({ changed, fits }: { changed: boolean; fits: boolean }) {
  const [open, setOpen] = useState(false);
  return (
    <details class="method" onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>
        {t("upload.how")} {changed && <span class="warn-text">{t("upload.changed")}</span>}
      </summary>
      {open && (
        <div class="card">
          <p class="quiet-text">{t("upload.how_for_next")}</p>
          <MethodForm
            chosen={chosen.value}
            choose={(now) => {
              chosen.value = now;
            }}
            known={(all) => {
              known.value = all;
            }}
          />
          {!fits && (
            <p class="error-text" role="alert">
              {t("upload.some_out_of_range")}
            </p>
          )}
          {changed && (
            <div class="buttons">
              <button
                type="button"
                onClick={() => {
                  chosen.value = USUAL;
                }}
              >
                {t("upload.as_usual")}
              </button>
            </div>
          )}
        </div>
      )}
    </details>
  );
}
