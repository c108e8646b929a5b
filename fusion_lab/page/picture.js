// A picture with boxes over it. Both change in the same frame: the old ones stay until the new image is decoded.
export default {
  template: `<div class="picture" :style="{ aspectRatio: width + '/' + height, maxWidth: width + 'px' }" :data-src="src" @click="pick">
    <div ref="image"></div>
    <svg ref="boxes" aria-hidden="true"></svg>
  </div>`,
  props: ["src", "overlay", "alt", "width", "height"],
  emits: ["pick"],
  mounted() {
    this.asked = this.answered = 0;
    this.show();
  },
  updated() {
    this.show();
  },
  methods: {
    async show() {
      const { src, overlay, alt, width, height } = this;
      const wanted = [src, overlay, alt].join("\n");
      if (!src || wanted === this.wanted) return;
      this.wanted = wanted;
      const turn = ++this.asked;
      const image = src === this.source ? this.$refs.image.firstChild : new Image();
      if (src !== this.source) {
        image.draggable = false;
        image.src = src;
        if (!(await image.decode().then(() => true, () => false))) return; // the old picture is better than a broken one
      }
      if (turn < this.answered) return; // a newer one came first
      this.answered = turn;
      this.source = src;
      image.alt = alt;
      this.$refs.image.replaceChildren(image);
      this.$refs.boxes.setAttribute("viewBox", `0 0 ${width} ${height}`);
      this.$refs.boxes.innerHTML = overlay;
    },
    pick(event) {
      const frame = this.$el.getBoundingClientRect();
      this.$emit("pick", [(event.clientX - frame.x) / frame.width, (event.clientY - frame.y) / frame.height]);
    },
  },
};
