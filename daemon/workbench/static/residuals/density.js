// More residuals than are drawn one by one: the stronger a place of a picture, the more rows lie there.
import {colours} from "../shared/theme.js";

const SIDES = ["still", "minus", "plus"]; // names of colours, in the server's order
const LEAST = 0.25; // how strong a place with a single row is: none is overlooked
const BEHIND = 0.18; // how strong what is not chosen is

/** Cells of a picture as one image, drawn anew only where counts or colours are other ones. */
export class Density {
  constructor(cells) {
    this.cells = cells;
    this.image = document.createElement("canvas");
    [this.image.width, this.image.height] = [cells.across, cells.up];
    this.made = null;
  }

  /** Draw `counted` (cells and counts as the server sends them) into a box. */
  draw(pen, counted, left, top, wide, tall, behind = false) {
    if (this.made?.[0] !== counted || this.made[1] !== colours().minus) {
      this.#make(counted);
      this.made = [counted, colours().minus];
    }
    pen.globalAlpha = behind ? BEHIND : 1;
    pen.imageSmoothingEnabled = false;
    pen.drawImage(this.image, left, top, wide, tall);
    pen.globalAlpha = 1;
  }

  #make(counted) {
    const {across, up} = this.cells;
    const pen = this.image.getContext("2d");
    const pixels = pen.createImageData(across, up), all = new Uint32Array(across * up);
    const own = SIDES.map(() => new Uint32Array(across * up));
    let at = 0, most = 1;
    counted.cell.forEach((step, k) => {
      at += step;
      const place = at % (across * up);
      own[Math.floor(at / (across * up))][place] += counted.count[k];
      all[place] += counted.count[k];
      most = Math.max(most, all[place]);
    });
    const shades = SIDES.map((name) => parts(pen, colours()[name]));
    for (let k = 0; k < all.length; k += 1) {
      if (!all[k]) continue;
      for (let c = 0; c < 3; c += 1)
        pixels.data[4 * k + c] = shades.reduce((sum, shade, s) => sum + (shade[c] * own[s][k]) / all[k], 0);
      pixels.data[4 * k + 3] = 255 * (LEAST + ((1 - LEAST) * Math.log1p(all[k] - 1)) / (Math.log(most) || 1));
    }
    pen.putImageData(pixels, 0, 0);
  }
}

/** Red, green, blue of a colour as the style sheet has it. */
function parts(pen, colour) {
  pen.fillStyle = colour;
  return [1, 3, 5].map((k) => parseInt(pen.fillStyle.slice(k, k + 2), 16));
}
