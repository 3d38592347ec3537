// <<title>>, in a browser or under node.
//
//   import { load } from "./<<p>>.mjs";
//   const finger = await load(await (await fetch("<<p>>.wasm")).arrayBuffer());
//   <<example>>
//
// Structs are plain objects with the fields of <<p>>.h; fields that are left out are zero. Each function returns its
// output by name, with the code; a negative code throws FingerError. Change finger.parameters at any time.

const INTERFACE = <<interface>>;

export class FingerError extends Error {
  constructor(code, text) {
    super(`${text} (${code})`);
    this.code = code;
  }
}

export async function load(bytes) {
  const { instance } = await WebAssembly.instantiate(bytes);
  return new Finger(instance.exports);
}

const sizeOf = (fields) => fields.reduce((sum, [, shape]) => sum + shape.reduce((a, b) => a * b, 1), 0);

class Finger {
  #c;
  #real;
  #start;

  constructor(exports) {
    this.#c = exports;
    this.#real = INTERFACE.real === "float" ? Float32Array : Float64Array;
    this.#start = (exports.__heap_base.value + 15) & ~15;
    for (const [owner, kept] of Object.entries(INTERFACE.kept)) {
      this[`new_${owner}`] = () => this.#keep(owner, kept);
    }
    if (!exports.<<p>>_init_abi) return;
    for (const [name, call] of Object.entries(INTERFACE.functions)) {
      this[name] = (...given) => this.#call(name, call, given);
    }
    this.#check(this.#c.<<p>>_init_abi(this.#start, INTERFACE.abi));
    this.parameters = this.#read(this.#start + this.#offset, INTERFACE.structs.parameters ?? []);
  }

  // The parameters follow the interface's number in the model.
  get #offset() {
    return this.#real.BYTES_PER_ELEMENT;
  }

  get version() {
    return this.#text(this.#c.<<p>>_version());
  }

  #call(name, { inputs, output }, given) {
    const c = this.#c;
    this.#write(this.#start + this.#offset, INTERFACE.structs.parameters ?? [], this.parameters);
    let at = this.#start + this.#offset + 8 * sizeOf(INTERFACE.structs.parameters ?? []) + 8;
    const passed = inputs.map(([argument, struct], k) => {
      if (struct === null) return given[k];
      const place = at;
      at += 8 * sizeOf(INTERFACE.structs[struct]);
      this.#write(place, INTERFACE.structs[struct], given[k] ?? {});
      return place;
    });
    const code = this.#check(c[`<<p>>_${name}`](this.#start, ...passed, at));
    return { code, [output[0]]: this.#read(at, INTERFACE.structs[output[1]]) };
  }

  // What a function keeps and works in lies before what calls need; step makes a call of it.
  #keep(owner, { function: name, bytes, members, inputs, output }) {
    const size = bytes.map((count) => (count + 15) & ~15);
    const [place, work] = [this.#start, this.#start + size[0]];
    this.#start += size[0] + size[1];
    this.#reserve(this.#start);
    this.#check(this.#c[`<<p>>_${owner}_init_abi`](place, INTERFACE.abi));
    const found = {};
    const places = {};
    let at = place + this.#offset;
    for (const member of members) {
      places[member] = at;
      found[member] = this.#read(at, INTERFACE.structs[member]);
      at += this.#real.BYTES_PER_ELEMENT * sizeOf(INTERFACE.structs[member]);
    }
    found.step = (...given) => {
      for (const member of members) this.#write(places[member], INTERFACE.structs[member], found[member]);
      let next = this.#start;
      const passed = inputs.map((struct, k) => {
        const to = next;
        next += 8 * sizeOf(INTERFACE.structs[struct]);
        this.#reserve(next);
        this.#write(to, INTERFACE.structs[struct], given[k] ?? {});
        return to;
      });
      this.#reserve(next + 8 * sizeOf(INTERFACE.structs[output]));
      const code = this.#check(this.#c[`<<p>>_${name}`](place, work, ...passed, next));
      return { code, [output]: this.#read(next, INTERFACE.structs[output]) };
    };
    return found;
  }

  #reserve(end) {
    const missing = end - this.#c.memory.buffer.byteLength;
    if (missing > 0) this.#c.memory.grow(Math.ceil(missing / 65536));
  }

  #check(code) {
    if (code < 0) throw new FingerError(code, this.#text(this.#c.<<p>>_strerror(code)));
    return code;
  }

  #write(place, fields, values) {
    for (const name of Object.keys(values)) {
      if (!fields.some(([field]) => field === name)) throw new TypeError(`there is no ${name}`);
    }
    const flat = fields.flatMap(([name, shape]) => {
      const count = shape.reduce((a, b) => a * b, 1);
      const value = [values[name] ?? new Array(count).fill(0)].flat(Infinity);
      if (value.length !== count) throw new TypeError(`${name}: expected ${count} numbers`);
      return value;
    });
    new this.#real(this.#c.memory.buffer, place, flat.length).set(flat);
  }

  #read(place, fields) {
    const flat = [...new this.#real(this.#c.memory.buffer, place, sizeOf(fields))];
    const shaped = (shape) =>
      shape.length === 0 ? flat.shift() : Array.from({ length: shape[0] }, () => shaped(shape.slice(1)));
    return Object.fromEntries(fields.map(([name, shape]) => [name, shaped(shape)]));
  }

  #text(place) {
    const bytes = new Uint8Array(this.#c.memory.buffer, place);
    return new TextDecoder().decode(bytes.subarray(0, bytes.indexOf(0)));
  }
}
