// <<title>>, in a browser or under node.
//
//   import { load } from "./<<p>>.mjs";
//   const finger = await load(await (await fetch("<<p>>.wasm")).arrayBuffer());
//   <<example>>
//
// Structs are plain objects with the fields of <<p>>.h. One that is left out or empty is as finger.begin(name) gives it:
// zeros, a measurement of which nothing was measured (NaN), the reference of the scene, the command before the first one.
// Of a measurement and of a reference a part may be given, the rest is as they begin; of all others every field. Each
// function returns its output by name, with the code; a negative code throws FingerError. Change finger.parameters at any
// time.

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

const countOf = (shape) => shape.reduce((a, b) => a * b, 1);
const sizeOf = (fields) => fields.reduce((sum, [, shape]) => sum + countOf(shape), 0);

class Finger {
  #c;
  #real;
  #start;

  constructor(exports) {
    this.#c = exports;
    this.#real = INTERFACE.real === "float" ? Float32Array : Float64Array;
    this.#start = (exports.__heap_base.value + 15) & ~15;
    for (const [owner, made] of Object.entries(INTERFACE.stateful)) {
      this[`new_${owner}`] = () => this.#keep(owner, made);
    }
    if (this.#text(exports.<<p>>_configuration()) !== INTERFACE.configuration || exports.<<p>>_abi() >>> 0 !== INTERFACE.abi) {
      throw new FingerError(-6, "the library is not of the package that this file is from");
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

  // A struct as it begins, with all of its fields.
  begin(struct) {
    const fields = INTERFACE.structs[struct];
    if (!fields) throw new TypeError(`there is no struct ${struct}`);
    const place = this.#start + this.#offset;
    this.#reserve(place + 8 * sizeOf(fields));
    new Uint8Array(this.#c.memory.buffer, place, 8 * sizeOf(fields)).fill(0);
    if (INTERFACE.begun.includes(struct)) this.#check(this.#c[`<<p>>_${struct}_init_abi`](place, INTERFACE.abi));
    return this.#read(place, fields);
  }

  // Where each field of a struct begins in its array, and how many numbers it has.
  layout(struct) {
    const found = {};
    let at = 0;
    for (const [name, shape] of INTERFACE.structs[struct]) {
      found[name] = { at, count: countOf(shape) };
      at += countOf(shape);
    }
    return found;
  }

  // The numbers that are given for a struct, completed.
  #complete(struct, given) {
    const names = INTERFACE.structs[struct].map(([name]) => name);
    for (const name of Object.keys(given ?? {})) {
      if (!names.includes(name)) throw new TypeError(`${struct}: there is no ${name}`);
    }
    const missing = names.filter((name) => given?.[name] === undefined);
    if (missing.length === 0) return given;
    const part = missing.length < names.length;
    if (part && !INTERFACE.open.includes(struct)) throw new TypeError(`${struct}: ${missing.join(", ")} missing`);
    const known = Object.fromEntries(Object.entries(given ?? {}).filter(([, value]) => value !== undefined));
    return { ...this.begin(struct), ...known };
  }

  get version() {
    return this.#text(this.#c.<<p>>_version());
  }

  #call(name, { inputs, output }, given) {
    const c = this.#c;
    const whole = inputs.map(([, struct], k) => (struct === null ? given[k] : this.#complete(struct, given[k])));
    this.#write(this.#start + this.#offset, INTERFACE.structs.parameters ?? [], this.parameters);
    let at = this.#start + this.#offset + 8 * sizeOf(INTERFACE.structs.parameters ?? []) + 8;
    const passed = inputs.map(([, struct], k) => {
      if (struct === null) return whole[k];
      const place = at;
      at += 8 * sizeOf(INTERFACE.structs[struct]);
      this.#write(place, INTERFACE.structs[struct], whole[k]);
      return place;
    });
    const code = this.#check(c[`<<p>>_${name}`](this.#start, ...passed, at));
    return { code, [output[0]]: this.#read(at, INTERFACE.structs[output[1]]) };
  }

  // What a function keeps and works in lies before what calls need; step and the other functions of it are called on it.
  #keep(owner, { function: name, bytes, members, inputs, output, methods }) {
    const size = bytes.map((count) => (count + 15) & ~15);
    const [place, work] = [this.#start, this.#start + size[0]];
    this.#start += size[0] + size[1];
    this.#reserve(this.#start);
    this.#check(this.#c[`<<p>>_${owner}_init_abi`](place, INTERFACE.abi));
    const found = {};
    Object.defineProperty(found, "address", { value: place }); // in the module's memory
    const places = {};
    let at = place + this.#offset;
    for (const member of members) {
      places[member] = at;
      found[member] = this.#read(at, INTERFACE.structs[member]);
      at += this.#real.BYTES_PER_ELEMENT * sizeOf(INTERFACE.structs[member]);
    }
    const call = (full, first, structs, result, given) => {
      const whole = structs.map((struct, k) => (struct === "number" ? given[k] : this.#complete(struct, given[k])));
      for (const member of members) this.#write(places[member], INTERFACE.structs[member], found[member]);
      let next = this.#start;
      const passed = structs.map((struct, k) => {
        if (struct === "number") return whole[k];
        const to = next;
        next += 8 * sizeOf(INTERFACE.structs[struct]);
        this.#reserve(next);
        this.#write(to, INTERFACE.structs[struct], whole[k]);
        return to;
      });
      if (result === null) return this.#c[`<<p>>_${full}`](...first, ...passed);
      this.#reserve(next + 8 * sizeOf(INTERFACE.structs[result]));
      const code = this.#check(this.#c[`<<p>>_${full}`](...first, ...passed, next));
      return { code, [result]: this.#read(next, INTERFACE.structs[result]) };
    };
    found.step = (...given) => call(name, [place, work], inputs, output, given);
    // A step for loops, without objects: arrays in the module's memory by struct, and call(), which returns the code. An
    // array that is read anew with its name is there also after the memory has grown.
    found.direct = () => {
      const direct = {};
      const at = [...inputs, output].map((struct) => {
        const fields = INTERFACE.structs[struct];
        const begun = this.begin(struct);
        const own = this.#start;
        this.#start += (8 * sizeOf(fields) + 15) & ~15;
        this.#reserve(this.#start);
        this.#write(own, fields, begun);
        const array = () => new this.#real(this.#c.memory.buffer, own, sizeOf(fields));
        Object.defineProperty(direct, struct, { enumerable: true, get: array });
        return own;
      });
      direct.call = () => this.#c[`<<p>>_${name}`](place, work, ...at);
      return direct;
    };
    for (const [method, { inputs: taken, output: result }] of Object.entries(methods)) {
      found[method] = (...given) => {
        const answer = call(`${owner}_${method}`, [place], taken, result, given);
        return result === null ? this.#check(answer) : answer[result];
      };
    }
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
      const value = [values[name]].flat(Infinity);
      if (value.length !== countOf(shape) || !value.every((one) => typeof one === "number")) {
        throw new TypeError(`${name}: expected ${countOf(shape)} numbers`);
      }
      return value;
    });
    new this.#real(this.#c.memory.buffer, place, flat.length).set(flat);
  }

  #read(place, fields) {
    const memory = this.#c.memory.buffer;
    let at = place;
    const one = (kind) => {
      const array = { uint32_t: Uint32Array, int: Int32Array, real: this.#real }[kind];
      const size = array.BYTES_PER_ELEMENT;
      at = Math.ceil(at / size) * size + size;
      return new array(memory, at - size, 1)[0];
    };
    const shaped = (shape, kind) =>
      shape.length === 0 ? one(kind) : Array.from({ length: shape[0] }, () => shaped(shape.slice(1), kind));
    return Object.fromEntries(fields.map(([name, shape, kind]) => [name, shaped(shape, kind)]));
  }

  #text(place) {
    const bytes = new Uint8Array(this.#c.memory.buffer, place);
    return new TextDecoder().decode(bytes.subarray(0, bytes.indexOf(0)));
  }
}
