// What is to be called as long as an element is there; it keeps the element, and what hangs on it, in no memory.

export class Attached {
  #elements = new Set(); // weak: an element that nobody else has is forgotten
  #acts = new WeakMap();
  #gone = new FinalizationRegistry((reference) => this.#elements.delete(reference));

  /** Have `act` called with whatever `call` is given, while the element is in the page. */
  add(element, act) {
    if (!this.#acts.has(element)) {
      const reference = new WeakRef(element);
      this.#elements.add(reference);
      this.#gone.register(element, reference);
      this.#acts.set(element, []);
    }
    this.#acts.get(element).push(act);
  }

  /** Call them; gives what they gave. */
  call(...values) {
    return [...this.#elements].map((reference) => reference.deref())
      .filter((element) => element?.isConnected)
      .flatMap((element) => this.#acts.get(element).map((act) => act(...values)));
  }
}
