/** Files out of what people drop or choose: folders with all that is in them, hidden files left out. */

export interface Gathered {
  files: File[];
  /** Hidden ones and what systems put beside files. */
  hidden: number;
}

const ADDED_BY_SYSTEMS = new Set(["thumbs.db", "desktop.ini", "__macosx"]);
// Navigation data, and the files that phones write beside the one of places: no logs by themselves.
const PART_OF_A_DRIVE =
  /(\.(nav|sp3|clk|eph|gal|\d\d[nplgqhf])|_[mgrecji]n\.rnx|^(accelerometer|gyroscope|barometer|orientation|gravity|magnetometer)[a-z]*\.csv)(\.gz)?$/i;

/** Whether a file or folder of that name is none that people mean. */
export function isHidden(name: string): boolean {
  return name.startsWith(".") || ADDED_BY_SYSTEMS.has(name.toLowerCase());
}

/** Whether some of these files look as if they belonged to others of them. */
export function belongTogether(names: string[], most: number): boolean {
  return names.length > 1 && names.length <= most && names.some((name) => PART_OF_A_DRIVE.test(name));
}

/** What a file field holds; of a folder, its files know their paths. */
export function chosenFiles(list: Iterable<File>): Gathered {
  const all = [...list];
  const files = all.filter((file) => !(file.webkitRelativePath || file.name).split("/").some(isHidden));
  return { files, hidden: all.length - files.length };
}

/** What was dropped. To be called while the drop is handled: its items are gone afterwards. */
export async function droppedFiles(data: DataTransfer): Promise<Gathered> {
  const entries = [...data.items].map((item) => item.webkitGetAsEntry?.() ?? null);
  if (entries.every((entry) => entry === null)) return chosenFiles(data.files);
  const gathered: Gathered = { files: [], hidden: 0 };
  for (const entry of entries) if (entry !== null) await take(entry, gathered);
  return gathered;
}

async function take(entry: FileSystemEntry, gathered: Gathered): Promise<void> {
  if (isHidden(entry.name)) {
    gathered.hidden += 1;
    return;
  }
  if (entry.isFile) {
    const file = entry as FileSystemFileEntry;
    gathered.files.push(await new Promise<File>((done, failed) => file.file(done, failed)));
    return;
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  for (;;) {
    // A reader gives a hundred entries at a time, and none when it has given all.
    const some = await new Promise<FileSystemEntry[]>((done, failed) => reader.readEntries(done, failed));
    if (some.length === 0) return;
    for (const one of some) await take(one, gathered);
  }
}
