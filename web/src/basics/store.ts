// Two small observables: a Cell has a value now, a Channel only passes messages on.

export type Listener<T> = (value: T) => void;

export class Channel<T> {
  private readonly listeners = new Set<Listener<T>>();

  on(listener: Listener<T>): () => void {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  emit(value: T): void {
    for (const listener of this.listeners) listener(value);
  }
}

export class Cell<T> {
  private readonly changes = new Channel<T>();

  constructor(private value: T) {}

  get(): T {
    return this.value;
  }

  set(value: T): void {
    this.value = value;
    this.changes.emit(value);
  }

  /** Call the listener now and on every change. */
  watch(listener: Listener<T>): () => void {
    listener(this.value);
    return this.changes.on(listener);
  }
}
