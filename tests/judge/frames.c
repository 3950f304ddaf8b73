// An independent judge of the virtual Kinect: what libfreenect delivers. `frames BITS COUNT` prints a line for each frame, its ticks and
// the CRC-32 of its 16-bit samples; with a third argument it is silent, for whoever counts instructions.
#include <libfreenect.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

static long wanted, got;
static int counts_only, bits;

static uint32_t crc32(const uint8_t *bytes, size_t length) {
    uint32_t crc = ~0u;
    while (length--) {
        crc ^= *bytes++;
        for (int bit = 0; bit < 8; bit++) crc = crc >> 1 ^ (0xedb88320u & -(crc & 1));
    }
    return ~crc;
}

static void on_depth(freenect_device *device, void *samples, uint32_t ticks) {
    (void)device;
    if (got++ >= wanted || counts_only) return;
    // No reading is 2047 in the truth, however many bits a sample has.
    for (uint16_t *sample = samples; bits == 10 && sample < (uint16_t *)samples + 640 * 480; sample++) {
        if (*sample == 1023) *sample = 2047;
    }
    printf("%u %u\n", ticks, crc32(samples, 640 * 480 * 2));
}

int main(int count, char **arguments) {
    freenect_context *context;
    freenect_device *device;
    if (count < 3) return 64;
    bits = atoi(arguments[1]);
    freenect_depth_format format = bits == 10 ? FREENECT_DEPTH_10BIT : FREENECT_DEPTH_11BIT;
    wanted = atol(arguments[2]);
    counts_only = count > 3;
    if (freenect_init(&context, NULL) < 0) return 1;
    freenect_select_subdevices(context, FREENECT_DEVICE_CAMERA);
    if (freenect_open_device(context, &device, 0) < 0) return 2;
    freenect_set_depth_callback(device, on_depth);
    freenect_set_depth_mode(device, freenect_find_depth_mode(FREENECT_RESOLUTION_MEDIUM, format));
    if (freenect_start_depth(device) < 0) return 3;
    while (got < wanted && freenect_process_events(context) >= 0) {}
    freenect_stop_depth(device);
    freenect_close_device(device);
    freenect_shutdown(context);
    return 0;
}
