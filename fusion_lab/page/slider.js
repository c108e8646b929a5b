// A range input of the browser's own, which brings role, value and keys along; a Quasar slider's thumb is focused and nameless.
export default {
  template: `<input type="range" :min="min" :max="max" :step="step" :value="modelValue" :disabled="disable"
    @input="$emit('update:modelValue', Number($event.target.value))">`,
  props: ["modelValue", "min", "max", "step", "disable"],
  emits: ["update:modelValue"],
};
