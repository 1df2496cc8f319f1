// Read arrays of a Zarr group with zarrita, run in the folder of its node_modules: node --input-type=module - GROUP OUT NAME…
// Numbers are written as they lie in memory, OUT/NAME.bin; OUT/shapes.json holds the shape of each array, and the values of strings and bools.
import { writeFileSync } from "node:fs"
import FileSystemStore from "@zarrita/storage/fs"
import * as zarr from "zarrita"

const [group, out, ...names] = process.argv.slice(2)
const shapes = {}
for (const name of names) {
  const array = await zarr.open(new FileSystemStore(`${group}/${name}`), { kind: "array" })
  const { data, shape } = await zarr.get(array)
  const isNumbers = ArrayBuffer.isView(data)
  shapes[name] = { shape, values: isNumbers ? null : Array.from(data) }
  if (isNumbers) writeFileSync(`${out}/${name}.bin`, data)
}
writeFileSync(`${out}/shapes.json`, JSON.stringify(shapes))
