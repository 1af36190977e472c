// Opens what `packed.py` packed: base64 of a deflated text (RFC 1951), at once.
//
// The browser's own DecompressionStream opens it later: a page that is printed as soon as it is
// loaded would have no pictures; and browsers before 2023 lack it.
function unpacked(node) {
  const letters = atob(node.textContent);
  const packed = new Uint8Array(letters.length);
  for (let i = 0; i < packed.length; i += 1) packed[i] = letters.charCodeAt(i);
  return new TextDecoder().decode(inflated(packed, Number(node.dataset.size)));
}

function inflated(packed, size) {
  const out = new Uint8Array(size);
  let [at, place, hold, held] = [0, 0, 0, 0];

  function need(count) {
    while (held < count) {
      hold |= packed[at++] << held;
      held += 8;
    }
  }

  function bits(count) {
    need(count);
    const value = hold & ((1 << count) - 1);
    hold >>>= count;
    held -= count;
    return value;
  }

  // Lengths of the canonical codes → symbol and length for each run of bits that may come next.
  function book(lengths) {
    const longest = Math.max(1, ...lengths);
    const table = new Uint16Array(1 << longest);
    let code = 0;
    for (let length = 1; length <= longest; length += 1, code <<= 1) {
      for (let symbol = 0; symbol < lengths.length; symbol += 1) {
        if (lengths[symbol] !== length) continue;
        let first = 0;
        for (let i = 0; i < length; i += 1) first |= ((code >> i) & 1) << (length - 1 - i);
        for (let i = first; i < table.length; i += 1 << length) table[i] = (symbol << 4) | length;
        code += 1;
      }
    }
    return { table, longest };
  }

  function symbol({ table, longest }) {
    need(longest);
    const found = table[hold & (table.length - 1)];
    hold >>>= found & 15;
    held -= found & 15;
    return found >> 4;
  }

  // Where each symbol's span of lengths or distances begins, and how many bits say where in it.
  function spans(first, extra) {
    let begin = first;
    return extra.map((count) => {
      const span = [begin, count];
      begin += 1 << count;
      return span;
    });
  }
  const steps = (count, each) =>
    Array.from({ length: count }, (_, i) => Math.max(0, Math.floor(i / each) - 1));
  const lengths = [...spans(3, steps(28, 4)), [258, 0]];
  const distances = spans(1, steps(30, 2));

  function described() {
    const [many, far, few] = [bits(5) + 257, bits(5) + 1, bits(4) + 4];
    const order = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
    const short = new Array(19).fill(0);
    for (let i = 0; i < few; i += 1) short[order[i]] = bits(3);
    const own = book(short);
    const all = [];
    while (all.length < many + far) {
      const next = symbol(own);
      if (next < 16) all.push(next);
      else if (next === 16) all.push(...new Array(3 + bits(2)).fill(all[all.length - 1]));
      else all.push(...new Array(next === 17 ? 3 + bits(3) : 11 + bits(7)).fill(0));
    }
    return [book(all.slice(0, many)), book(all.slice(many))];
  }

  function agreed() {
    const fixed = Array.from({ length: 288 }, (_, i) => (i < 144 ? 8 : i < 256 ? 9 : i < 280 ? 7 : 8));
    return [book(fixed), book(new Array(30).fill(5))];
  }

  function stored() {
    bits(held & 7);
    const count = bits(16);
    bits(16);
    for (let i = 0; i < count; i += 1) out[place++] = bits(8);
  }

  function coded([letter, distance]) {
    for (let next = symbol(letter); next !== 256; next = symbol(letter)) {
      if (next < 256) {
        out[place++] = next;
        continue;
      }
      const [shortest, more] = lengths[next - 257];
      const end = place + shortest + bits(more);
      const [nearest, further] = distances[symbol(distance)];
      const back = nearest + bits(further);
      for (; place < end; place += 1) out[place] = out[place - back];
    }
  }

  for (let last = 0; !last; ) {
    last = bits(1);
    const kind = bits(2);
    if (kind === 0) stored();
    else coded(kind === 1 ? agreed() : described());
  }
  return out;
}
