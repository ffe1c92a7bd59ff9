/** The shelf in this browser's IndexedDB: a list of recordings, and their chunks by recording and time, none over another. */
import type { Chunk, Recording, Shelf } from "./keeper";

const NAME = "versant-recordings";
const RECORDINGS = "recordings";
const CHUNKS = "chunks";

function answered<T>(request: IDBRequest<T>): Promise<T> {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
  });
}

/** Opened for each use: browsers close what was open while a page slept. */
async function opened(): Promise<IDBDatabase> {
  const request = indexedDB.open(NAME, 1);
  request.onupgradeneeded = () => {
    request.result.createObjectStore(RECORDINGS, { keyPath: "id" });
    request.result.createObjectStore(CHUNKS);
  };
  return answered(request);
}

type Work<T> = (recordings: IDBObjectStore, chunks: IDBObjectStore) => Promise<T> | undefined;

/** What fails half way leaves nothing behind. */
async function attempted<T>(transaction: IDBTransaction, work: Work<T>): Promise<T | undefined> {
  try {
    return work(transaction.objectStore(RECORDINGS), transaction.objectStore(CHUNKS));
  } catch (error) {
    transaction.abort();
    throw error;
  }
}

async function inside<T>(mode: IDBTransactionMode, work: Work<T>): Promise<T | undefined> {
  const database = await opened();
  try {
    // On the disk before it counts as kept: a battery that is empty loses what stood in memory.
    const transaction = database.transaction([RECORDINGS, CHUNKS], mode, { durability: "strict" });
    const over = new Promise<void>((resolve, reject) => {
      transaction.oncomplete = () => resolve();
      transaction.onabort = () => reject(transaction.error ?? new Error("aborted"));
    });
    const answer = attempted(transaction, work);
    const [found] = await Promise.all([answer, over]);
    return found;
  } finally {
    database.close();
  }
}

const chunksOf = (id: string) => IDBKeyRange.bound([id], [id, []]);

export const shelf: Shelf = {
  async all() {
    const found = await inside("readonly", (recordings) =>
      answered(recordings.getAll() as IDBRequest<Recording[]>),
    );
    return (found ?? []).sort((a, b) => b.began_ms - a.began_ms);
  },
  async put(recording: Recording, chunk?: Chunk) {
    await inside("readwrite", (recordings, chunks) => {
      recordings.put(recording);
      if (chunk !== undefined) chunks.add(chunk, [recording.id, Date.now(), recording.chunks]);
      return undefined;
    });
  },
  async chunks(id: string) {
    const found = await inside("readonly", (_, chunks) =>
      answered(chunks.getAll(chunksOf(id)) as IDBRequest<Chunk[]>),
    );
    return found ?? [];
  },
  async remove(id: string) {
    await inside("readwrite", (recordings, chunks) => {
      recordings.delete(id);
      chunks.delete(chunksOf(id));
      return undefined;
    });
  },
};
